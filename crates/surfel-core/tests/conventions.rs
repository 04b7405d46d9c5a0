//! `CONVENTIONS.md`, line by line: each test is named in the line it holds to.

use glam::{DMat3, DQuat, DVec2, DVec3};
use std::f64::consts::{FRAC_1_SQRT_2, PI};
use surfel_core::normals::normals_from_depth;
use surfel_core::nyquist::{NyquistMode, adapt, frequency_ratio, sampling_rate};
use surfel_core::sh::{self, ShRotation};
use surfel_core::{Camera, Grid, Intrinsics, Rigid, Similarity, Surfels, View};

fn camera() -> Camera {
    Camera {
        intrinsics: Intrinsics { fx: 40.0, fy: 42.0, cx: 16.0, cy: 12.0 },
        width: 32,
        height: 24,
        camera_from_world: Rigid::IDENTITY,
    }
}

fn close(a: DVec3, b: DVec3) -> bool {
    (a - b).length() < 1e-12
}

#[test]
fn camera_axes_are_right_down_forward() {
    let pixel = |p: DVec3| camera().project(p).map(|(pixel, _)| pixel);
    let middle = pixel(DVec3::Z).unwrap();
    assert!(pixel(DVec3::new(0.1, 0.0, 1.0)).unwrap().x > middle.x, "X is right");
    assert!(pixel(DVec3::new(0.0, 0.1, 1.0)).unwrap().y > middle.y, "Y is down");
    assert!(pixel(DVec3::NEG_Z).is_none(), "Z is forward");
    assert_eq!(camera().forward(), DVec3::Z);
}

#[test]
fn transforms_compose_by_their_names() {
    let a_from_b = Rigid::from_quat(DQuat::from_rotation_x(0.3), DVec3::new(1.0, 2.0, 3.0));
    let b_from_c = Rigid::from_quat(DQuat::from_rotation_y(-0.8), DVec3::new(-4.0, 0.5, 0.0));
    let point_c = DVec3::new(0.1, -0.7, 2.0);
    let a_from_c = a_from_b * b_from_c;
    assert!(close(a_from_c.transform(point_c), a_from_b.transform(b_from_c.transform(point_c))));
    let moved = Camera { camera_from_world: a_from_b, ..camera() };
    assert!(close(a_from_b.transform(moved.centre()), DVec3::ZERO), "the centre is the camera's own origin");
}

#[test]
fn first_pixel_centre_is_at_one_half() {
    assert_eq!(Camera::pixel_centre(0, 0), DVec2::new(0.5, 0.5));
    assert!(camera().contains(DVec2::ZERO) && !camera().contains(DVec2::new(32.0, 0.0)));
    let opencv = Intrinsics::from_index_coordinates(40.0, 42.0, 15.5, 11.5);
    assert_eq!(opencv, camera().intrinsics);
    assert_eq!(opencv.principal_index(), DVec2::new(15.5, 11.5));
}

#[test]
fn resizing_multiplies_intrinsics() {
    let point = DVec3::new(0.2, -0.1, 1.5);
    let (pixel, _) = camera().project(point).unwrap();
    let (twice, _) = camera().resized(64, 48).project(point).unwrap();
    assert!((twice - pixel * 2.0).length() < 1e-12);
    let (cut, _) = camera().cropped(5, 3, 10, 10).project(point).unwrap();
    assert!((cut - (pixel - DVec2::new(5.0, 3.0))).length() < 1e-12);
}

#[test]
fn depth_is_z_not_ray_length() {
    let point = DVec3::new(0.9, -0.4, 2.0);
    let (pixel, depth) = camera().project(point).unwrap();
    assert_eq!(depth, 2.0);
    assert!(close(camera().unproject(pixel, depth), point));
    assert_eq!(camera().ray(pixel).z, 1.0);
}

#[test]
fn zero_is_no_depth() {
    for hole in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let depth = Grid::from_fn(7, 7, |x, y| if (x, y) == (3, 3) { hole } else { 2.0 });
        let normals = normals_from_depth(&depth, &camera().intrinsics);
        for (x, y) in [(3, 3), (2, 3), (4, 3), (3, 2), (3, 4)] {
            assert!(normals[(x, y)].is_none(), "{hole} at {x},{y}");
        }
        assert!(normals[(1, 1)].is_some());
    }
}

/// A surfel whose quaternion is a quarter turn about Z, written w x y z.
fn quarter_turn() -> Surfels {
    let half = FRAC_1_SQRT_2 as f32;
    Surfels { rotations: vec![[half, 0.0, 0.0, half]], ..Surfels::default() }
}

/// `world_from_surfel` of the first surfel, as every consumer must read it.
fn world_from_surfel(surfels: &Surfels) -> DMat3 {
    let [w, x, y, z] = surfels.rotations[0].map(f64::from);
    DMat3::from_quat(DQuat::from_xyzw(x, y, z, w))
}

#[test]
fn quaternions_are_w_x_y_z() {
    let identity = Surfels { rotations: vec![[1.0, 0.0, 0.0, 0.0]], ..Surfels::default() };
    assert_eq!(world_from_surfel(&identity), DMat3::IDENTITY);
    let turned = world_from_surfel(&quarter_turn()) * DVec3::X;
    assert!((turned - DVec3::Y).length() < 1e-6, "{turned}");
}

#[test]
fn surfel_rotation_columns_are_tangents_and_normal() {
    let frame = world_from_surfel(&quarter_turn());
    let (t_u, t_v, t_w) = (frame.x_axis, frame.y_axis, frame.z_axis);
    assert!((t_u - DVec3::Y).length() < 1e-6);
    assert!((t_v - DVec3::NEG_X).length() < 1e-6);
    assert!((t_w - DVec3::Z).length() < 1e-6);
}

#[test]
fn normals_face_the_camera() {
    let depth = Grid::from_fn(32, 24, |x, y| 2.0 + 0.03 * x as f32 - 0.02 * y as f32);
    let normals = normals_from_depth(&depth, &camera().intrinsics);
    for y in 1..23 {
        for x in 1..31 {
            let normal = DVec3::from(normals[(x, y)].unwrap().map(f64::from));
            assert!(normal.dot(camera().ray(Camera::pixel_centre(x, y))) < 0.0, "{normal} at {x},{y}");
            assert!((normal.length() - 1.0).abs() < 1e-6);
        }
    }
}

#[test]
fn sh_basis_and_index() {
    let at = |d: DVec3, l: usize, m: isize| sh::basis(d)[(l * l + l).wrapping_add_signed(m)];
    let c1 = (3.0 / (4.0 * PI)).sqrt();
    assert!((at(DVec3::Y, 1, -1) + c1).abs() < 1e-12, "l = 1, m = -1 is -y");
    assert!((at(DVec3::Z, 1, 0) - c1).abs() < 1e-12, "l = 1, m = 0 is z");
    assert!((at(DVec3::X, 1, 1) + c1).abs() < 1e-12, "l = 1, m = 1 is -x");
    assert_eq!(sh::to_colour([0.0; 3]), [0.5; 3], "colour = sum + 0.5");
    assert_eq!(sh::to_colour([-9.0; 3]), [0.0; 3], "clamped at 0");
    // Coefficients given in a camera's frame must show the same colour in the world's.
    let world_from_camera = DMat3::from_rotation_y(0.6);
    let mut coefficients: Vec<f64> = (0..16).map(|i| 0.1 * f64::from(i) - 0.7).collect();
    let shown = |c: &[f64], d: DVec3| sh::basis(d).iter().zip(c).map(|(b, c)| b * c).sum::<f64>();
    let in_camera = shown(&coefficients, DVec3::Z);
    ShRotation::new(world_from_camera).apply(&mut coefficients);
    assert!((shown(&coefficients, world_from_camera * DVec3::Z) - in_camera).abs() < 1e-12);
}

#[test]
fn sh_layout_is_coefficient_major() {
    let mut surfels = Surfels { sh_degree: 1, ..Surfels::default() };
    for k in 0..3 {
        surfels.centres.push([0.0; 3]);
        surfels.scales.push([1.0; 2]);
        surfels.rotations.push([1.0, 0.0, 0.0, 0.0]);
        surfels.opacities.push(0.5);
        surfels.sh.extend((0..4).map(|n| [(10 * k + n) as f32, 0.0, 0.0]));
    }
    assert!(surfels.is_consistent());
    assert_eq!(surfels.sh[2 * surfels.num_coefficients() + 3][0], 23.0);
    surfels.sh.pop();
    assert!(!surfels.is_consistent());
}

#[test]
fn lengths_are_scene_units() {
    let unit = 1000.0;
    let camera_from_world = Rigid::from_quat(DQuat::from_rotation_y(0.2), DVec3::new(0.3, 0.0, 0.1));
    let metres = Camera { camera_from_world, ..camera() };
    let millimetres = metres.in_frame(&Similarity { scale: unit, ..Similarity::IDENTITY });
    let point = DVec3::new(0.1, 0.2, 3.0);
    let (pixel, depth) = metres.project(point).unwrap();
    let (same_pixel, thousandfold) = millimetres.project(point * unit).unwrap();
    assert!((pixel - same_pixel).length() < 1e-9 && (thousandfold - unit * depth).abs() < 1e-9);
    let ratio = |z: f64, scale: f64| {
        let k = camera().intrinsics;
        let rate = sampling_rate(NyquistMode::Consistent, k.fx, k.fy, z);
        frequency_ratio(adapt(NyquistMode::Consistent, scale, rate, 1.0), rate)
    };
    assert!((ratio(depth, 0.002) - ratio(thousandfold, 0.002 * unit)).abs() < 1e-12);
}

#[test]
fn colours_are_srgb() {
    // Linearised, mid-gray would have a luma of about 0.21.
    let view = View::new("gray", Grid::filled(32, 24, [0.5; 3]), camera());
    assert!(view.gray().as_slice().iter().all(|luma| (luma - 0.5).abs() < 1e-6));
    let shown = sh::to_colour(sh::from_colour([0.25, 0.5, 0.75]));
    assert!(shown.iter().zip([0.25, 0.5, 0.75]).all(|(a, b)| (a - b).abs() < 1e-6));
}

#[test]
fn grids_are_row_major_from_the_top_left() {
    let grid = Grid::from_fn(3, 2, |x, y| 10 * y + x);
    assert_eq!(grid.as_slice(), [0, 1, 2, 10, 11, 12]);
    assert_eq!((grid[(2, 1)], grid.row(1)), (12, &[10, 11, 12][..]));
}
