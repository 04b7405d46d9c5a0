//! Footprint regions `R_k` (spec 1.9.7): the pixels of each view that see more than epsilon of a surfel.
//!
//! Uses the rasterizer's own ray-splat code. Invariant: a surfel's region holds its own pixel, so that
//! attention always has something to attend to.

use super::{Shapes, is_near_image};
use crate::config::NyquistConfig;
use crate::ops::gather_attention::{Regions, Window};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use surfel_core::Camera;
use surfel_raster::pixel_camera::PixelCamera;
use surfel_raster::ray_splat::Footprint;
use surfel_raster::slices::SurfelShape;

/// Regions of surfels with the given (adapted) scales. The cameras are checked ones of equal size.
pub fn regions(
    shapes: &Shapes,
    scales: &[[f64; 2]],
    cameras: &[Camera],
    targets: &[Vec<usize>],
    near_clips: &[f64],
    config: &NyquistConfig,
) -> Regions {
    let (width, height) = (cameras[0].width, cameras[0].height);
    let pixel_cameras: Vec<Option<PixelCamera>> = cameras.iter().map(|camera| PixelCamera::new(camera).ok()).collect();
    let finder = Finder { config, cutoff: (-2.0 * config.epsilon.ln()).sqrt() };
    let num_targets = targets.first().map_or(0, Vec::len);
    let mut windows = vec![Window::default(); shapes.centres.len() * num_targets];
    windows.par_chunks_mut(num_targets.max(1)).enumerate().for_each(|(k, windows)| {
        let home = k / (width * height);
        let shape = SurfelShape {
            centre: DVec3::from(shapes.centres[k].map(f64::from)),
            scales: DVec2::from(scales[k]),
            rotation: shapes.rotations[k].map(f64::from),
            opacity: 1.0,
        };
        for (window, &view) in windows.iter_mut().zip(&targets[home]) {
            let visible = is_near_image(&cameras[view], shape.centre, near_clips[view], 0.0).is_some();
            if let Some(camera) = pixel_cameras[view].as_ref().filter(|_| visible || view == home) {
                *window = finder.window(camera, &shape, near_clips[view]);
            }
            if view == home && window.mask == 0 {
                let (x, y) = (k % (width * height) % width, k % (width * height) / width);
                *window = Window { x: x as i32, y: y as i32, step: 1, mask: 1 };
            }
        }
    });
    Regions { width, height, side: 2 * config.radius + 1, targets: targets.to_vec(), windows }
}

/// Cutoff at which the rasterizer places the low-pass (spec 3.3).
const RASTER_CUTOFF: f64 = 3.0;

struct Finder<'a> {
    config: &'a NyquistConfig,
    /// Standard deviations at which the value falls to epsilon.
    cutoff: f64,
}

impl Finder<'_> {
    fn window(&self, camera: &PixelCamera, shape: &SurfelShape, near_clip: f64) -> Window {
        let (side, radius) = (2 * self.config.radius + 1, self.config.radius as i32);
        let Some(footprint) = Footprint::of(camera, shape, near_clip, RASTER_CUTOFF) else {
            return Window::default();
        };
        let Some((middle, half)) = footprint.transform.bounds(self.cutoff) else {
            return Window::default();
        };
        let in_camera = camera.camera_from_world.transform(shape.centre);
        let centre = camera.focal * in_camera.truncate() / in_camera.z + camera.principal;
        // The low-pass (standard deviation sqrt(1/2) pixel) keeps this much visible however thin the footprint.
        let lowpass = (footprint.lowpass_centre - centre).abs() + self.cutoff * std::f64::consts::FRAC_1_SQRT_2;
        let reach = (half + (middle - centre).abs()).max(lowpass);
        let needed = (reach.max_element() / f64::from(radius)).ceil().clamp(1.0, 1e6);
        let step = if self.config.adaptive_stride { needed as i32 } else { 1 };
        let first = centre.round().clamp(DVec2::splat(-1e6), DVec2::splat(1e6)).as_ivec2() - radius * step;
        let mut mask = 0u64;
        for bit in 0..side * side {
            let x = i64::from(first.x) + (bit % side) as i64 * i64::from(step);
            let y = i64::from(first.y) + (bit / side) as i64 * i64::from(step);
            let inside = x >= 0 && y >= 0 && x < camera.width as i64 && y < camera.height as i64;
            let near = (x as f64 - centre.x).abs() <= reach.x && (y as f64 - centre.y).abs() <= reach.y;
            if inside && near && footprint.value(x as f64, y as f64) > self.config.epsilon {
                mask |= 1 << bit;
            }
        }
        Window { x: first.x, y: first.y, step, mask }
    }
}
