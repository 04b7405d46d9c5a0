//! What must hold of any rendering: order, unit, slant, threads, known pictures.

mod support;

use glam::{DMat3, DVec3};
use proptest::prelude::*;
use support::{camera, map_grads, surfels};
use surfel_core::{Camera, Intrinsics, Rigid, Surfels, sh};
use surfel_raster::{Maps, RenderConfig, SurfelSlices, backward, forward, render};

fn maps_of(surfels: &Surfels, camera: &Camera, config: &RenderConfig) -> Maps {
    render(&SurfelSlices::from(surfels), camera, config).expect("a sound scene")
}

/// The surfels in another order: surfel `order[k]` at `k`.
fn permuted(surfels: &Surfels, order: &[usize]) -> Surfels {
    let n = surfels.num_coefficients();
    Surfels {
        centres: order.iter().map(|&k| surfels.centres[k]).collect(),
        scales: order.iter().map(|&k| surfels.scales[k]).collect(),
        rotations: order.iter().map(|&k| surfels.rotations[k]).collect(),
        opacities: order.iter().map(|&k| surfels.opacities[k]).collect(),
        sh: order.iter().flat_map(|&k| surfels.sh[k * n..][..n].iter().copied()).collect(),
        sh_degree: surfels.sh_degree,
    }
}

/// A camera at the origin looking along +Z.
fn plain_camera(width: usize, height: usize, focal: f64) -> Camera {
    Camera {
        intrinsics: Intrinsics { fx: focal, fy: focal, cx: width as f64 / 2.0, cy: height as f64 / 2.0 },
        width,
        height,
        camera_from_world: Rigid::IDENTITY,
    }
}

/// One disc on the optical axis at z = 2, turned by `angle` about the image's vertical.
fn disc(angle: f64, scale: f32) -> Surfels {
    Surfels {
        centres: vec![[0.0, 0.0, 2.0]],
        scales: vec![[scale, scale]],
        rotations: vec![[(angle / 2.0).cos() as f32, 0.0, (angle / 2.0).sin() as f32, 0.0]],
        opacities: vec![0.9],
        sh: vec![sh::from_colour([1.0, 0.5, 0.25])],
        sh_degree: 0,
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_order_of_surfels_does_not_matter(seed in 0u64..1000, stride in 1usize..96) {
        let camera = camera(37, 29);
        let surfels = surfels(&camera, 97, 1, seed);
        // 97 is prime: every stride walks through all surfels.
        let order: Vec<usize> = (0..97).map(|k| (k * stride + 5) % 97).collect();
        let shuffled = permuted(&surfels, &order);
        let config = RenderConfig::default();
        prop_assert_eq!(maps_of(&surfels, &camera, &config), maps_of(&shuffled, &camera, &config));

        let grads = map_grads(37, 29, seed);
        let grads_of = |surfels: &Surfels| {
            let slices = SurfelSlices::from(surfels);
            let (_, tape) = forward(&slices, &camera, &config).expect("a sound scene");
            backward(&slices, &tape, &grads).expect("a sound scene")
        };
        let (plain, mixed) = (grads_of(&surfels), grads_of(&shuffled));
        for (k, &original) in order.iter().enumerate() {
            prop_assert_eq!(mixed.centres[k], plain.centres[original]);
            prop_assert_eq!(mixed.rotations[k], plain.rotations[original]);
        }
    }

    #[test]
    fn the_unit_of_length_does_not_matter(seed in 0u64..1000, exponent in -20i32..20) {
        // A power of two scales f32 without rounding.
        let k = 2f64.powi(exponent);
        let camera = camera(37, 29);
        let surfels = surfels(&camera, 80, 1, seed);
        let mut scaled = surfels.clone();
        scaled.centres.iter_mut().flatten().for_each(|c| *c *= k as f32);
        scaled.scales.iter_mut().flatten().for_each(|s| *s *= k as f32);
        let mut scaled_camera = camera;
        scaled_camera.camera_from_world.translation *= k;
        let plain = maps_of(&surfels, &camera, &RenderConfig::for_depth_range(1.0, 4.0));
        let grown = maps_of(&scaled, &scaled_camera, &RenderConfig::for_depth_range(k, 4.0 * k));
        for i in 0..plain.alpha.len() {
            let close = |a: f32, b: f32| (a - b).abs() <= 1e-5 * a.abs().max(1.0);
            prop_assert!(close(plain.alpha.as_slice()[i], grown.alpha.as_slice()[i]));
            prop_assert!(close(plain.distortion.as_slice()[i], grown.distortion.as_slice()[i]));
            prop_assert!(close(plain.depth_median.as_slice()[i], grown.depth_median.as_slice()[i] / k as f32));
            prop_assert!(close(plain.depth_sum.as_slice()[i], grown.depth_sum.as_slice()[i] / k as f32));
            for c in 0..3 {
                prop_assert!(close(plain.colour.as_slice()[i][c], grown.colour.as_slice()[i][c]));
                prop_assert!(close(plain.normal.as_slice()[i][c], grown.normal.as_slice()[i][c]));
            }
        }
    }
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let camera = camera(90, 70);
    let surfels = surfels(&camera, 5000, 2, 8);
    let slices = SurfelSlices::from(&surfels);
    let grads = map_grads(90, 70, 9);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let (maps, tape) = forward(&slices, &camera, &RenderConfig::default()).expect("a sound scene");
            (maps, backward(&slices, &tape, &grads).expect("a sound scene"))
        })
    };
    let alone = with(1);
    assert!(alone == with(2) && alone == with(5));
}

#[test]
fn a_scene_far_from_the_origin_looks_the_same() {
    let camera = camera(48, 40);
    let mut surfels = surfels(&camera, 120, 1, 21);
    // Coordinates that survive the shift in f32, so that only the rasterizer can lose precision.
    surfels.centres.iter_mut().flatten().for_each(|c| *c = (*c * 64.0).round() / 64.0);
    let near = maps_of(&surfels, &camera, &RenderConfig::default());
    let shift = DVec3::new(65_536.0, -32_768.0, 16_384.0);
    let mut far = surfels.clone();
    for centre in &mut far.centres {
        *centre = std::array::from_fn(|i| centre[i] + shift[i] as f32);
    }
    let mut far_camera = camera;
    let pose = &mut far_camera.camera_from_world;
    pose.translation -= pose.rotation * shift;
    let moved = maps_of(&far, &far_camera, &RenderConfig::default());
    for (a, b) in near.alpha.as_slice().iter().zip(moved.alpha.as_slice()) {
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
}

#[test]
fn a_turning_disc_narrows_with_the_cosine_and_never_vanishes() {
    let camera = plain_camera(64, 64, 100.0);
    let config = RenderConfig { centre_depth_when_lowpass: true, ..RenderConfig::default() };
    let area = |angle: f64| maps_of(&disc(angle, 0.16), &camera, &config).alpha.as_slice().iter().sum::<f32>();
    let face_on = area(0.0);
    for degrees in [15.0f64, 30.0, 45.0, 60.0, 75.0] {
        let ratio = f64::from(area(degrees.to_radians()) / face_on);
        assert!((ratio / degrees.to_radians().cos() - 1.0).abs() < 0.06, "{degrees} degrees: {ratio}");
    }
    let almost_edge_on = maps_of(&disc(89.99f64.to_radians(), 0.16), &camera, &config);
    assert!(almost_edge_on.alpha[(32, 32)] > 0.3, "the low-pass keeps an edge-on disc visible");
    assert!(almost_edge_on.depth_median[(32, 32)] > 1.5);
}

#[test]
fn normals_face_the_camera_from_both_sides() {
    let camera = plain_camera(32, 32, 50.0);
    for angle in [0.4f64, 0.4 + std::f64::consts::PI] {
        let maps = maps_of(&disc(angle, 0.2), &camera, &RenderConfig::default());
        let (normal, alpha) = (maps.normal[(16, 16)], maps.alpha[(16, 16)]);
        assert!(normal[2] < 0.0);
        let expected = DMat3::from_rotation_y(0.4) * DVec3::NEG_Z * f64::from(alpha);
        assert!((DVec3::from(normal.map(f64::from)) - expected).length() < 1e-5, "{normal:?}");
    }
}

#[test]
fn a_plane_of_surfels_has_the_planes_depth() {
    let camera = plain_camera(48, 36, 60.0);
    let normal = DVec3::new(0.3, 0.2, -1.0).normalize();
    let depth_at = |x: f64, y: f64| -3.0 / normal.dot(camera.ray(glam::DVec2::new(x, y)));
    let turn = glam::DQuat::from_rotation_arc(DVec3::Z, -normal);
    let mut plane = Surfels::default();
    for y in 0..36 {
        for x in 0..48 {
            let pixel = Camera::pixel_centre(x, y);
            let depth = depth_at(pixel.x, pixel.y);
            plane.centres.push(camera.unproject(pixel, depth).as_vec3().to_array());
            plane.scales.push([(depth / 60.0) as f32; 2]);
            plane.rotations.push([turn.w as f32, turn.x as f32, turn.y as f32, turn.z as f32]);
            plane.opacities.push(0.9);
            plane.sh.push([0.0; 3]);
        }
    }
    let maps = maps_of(&plane, &camera, &RenderConfig::default());
    for y in 2..34 {
        for x in 2..46 {
            let expected = depth_at(x as f64 + 0.5, y as f64 + 0.5);
            for found in [maps.depth_median[(x, y)], maps.depth_expected[(x, y)]] {
                assert!((f64::from(found) / expected - 1.0).abs() < 1e-3, "{found} at {x},{y}, plane {expected}");
            }
        }
    }
}
