//! What the network makes: one surfel per pixel of two views of a wavy wall.

use glam::{DMat3, DVec3};
use surfel_core::{Camera, Intrinsics, Rigid, Surfels, sh};

/// Surfels of `footprint` pixels' standard deviation, and a camera between the views.
pub fn two_views(width: usize, height: usize, footprint: f64) -> (Surfels, Camera) {
    let camera = |x: f64| Camera {
        intrinsics: Intrinsics { fx: width as f64, fy: width as f64, cx: width as f64 / 2.0, cy: height as f64 / 2.0 },
        width,
        height,
        camera_from_world: Rigid { rotation: DMat3::from_rotation_y(0.1 * x), translation: DVec3::new(-x, 0.0, 0.0) },
    };
    let mut surfels = Surfels { sh_degree: 3, ..Surfels::default() };
    for view in [camera(-0.3), camera(0.3)] {
        for y in 0..height {
            for x in 0..width {
                let pixel = Camera::pixel_centre(x, y);
                let (a, b) = (pixel.x / width as f64, pixel.y / width as f64);
                let depth = 3.5 + 0.5 * (9.0 * a).sin() * (7.0 * b).cos();
                let scale = (footprint * depth / view.intrinsics.fx) as f32;
                surfels.centres.push(view.unproject(pixel, depth).as_vec3().to_array());
                surfels.scales.push([scale, scale]);
                surfels.rotations.push([1.0, (0.3 * (9.0 * a).cos()) as f32, (0.3 * (7.0 * b).sin()) as f32, 0.0]);
                surfels.opacities.push(0.9);
                surfels.sh.push(sh::from_colour([a as f32, b as f32, 0.5]));
                surfels.sh.extend((1..16).map(|n| [0.01 * n as f32; 3]));
            }
        }
    }
    (surfels, camera(0.1))
}
