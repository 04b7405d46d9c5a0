//! Inputs no one should pass: the picture of the good surfels must not change, and nothing may panic.

mod support;

use support::{camera, map_grads, surfels};
use surfel_core::Surfels;
use surfel_raster::{RasterError, RenderConfig, SurfelGrads, SurfelSlices, backward, forward, render};

fn push(into: &mut Surfels, centre: [f32; 3], scales: [f32; 2], rotation: [f32; 4], opacity: f32, colour: f32) {
    into.centres.push(centre);
    into.scales.push(scales);
    into.rotations.push(rotation);
    into.opacities.push(opacity);
    into.sh.extend(vec![[colour; 3]; into.num_coefficients()]);
}

fn all_finite(grads: &SurfelGrads) -> bool {
    let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
    finite(grads.centres.as_flattened())
        && finite(grads.scales.as_flattened())
        && finite(grads.rotations.as_flattened())
        && finite(&grads.opacities)
        && finite(grads.sh.as_flattened())
}

#[test]
fn broken_surfels_are_skipped() {
    let camera = camera(30, 20);
    let good = surfels(&camera, 50, 1, 4);
    let config = RenderConfig::default();
    let expected = render(&SurfelSlices::from(&good), &camera, &config).expect("a sound scene");
    let (p, s, q) =
        (camera.unproject(glam::DVec2::new(15.0, 10.0), 1.0).as_vec3().to_array(), [0.1; 2], [1.0, 0.0, 0.0, 0.0]);
    let behind = camera.unproject(glam::DVec2::new(15.0, 10.0), -1.0).as_vec3().to_array();
    let mut table: Vec<(&str, [f32; 3], [f32; 2], [f32; 4], f32, f32)> = vec![
        ("zero quaternion", p, s, [0.0; 4], 0.9, 0.1),
        ("zero scale", p, [0.0, 0.1], q, 0.9, 0.1),
        ("negative scale", p, [0.1, -0.1], q, 0.9, 0.1),
        ("behind the camera", behind, s, q, 0.9, 0.1),
        ("around the camera", camera.centre().as_vec3().to_array(), [100.0; 2], q, 0.9, 0.1),
        ("transparent", p, s, q, 0.0, 0.1),
        ("negative opacity", p, s, q, -1.0, 0.1),
        ("far away", [f32::MAX, 0.0, f32::MAX], s, q, 0.9, 0.1),
    ];
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        table.push(("centre", [p[0], bad, p[2]], s, q, 0.9, 0.1));
        table.push(("scale", p, [0.1, bad], q, 0.9, 0.1));
        table.push(("rotation", p, s, [1.0, bad, 0.0, 0.0], 0.9, 0.1));
        table.push(("opacity", p, s, q, bad, 0.1));
        table.push(("colour", p, s, q, 0.9, bad));
    }
    let grads = map_grads(30, 20, 1);
    for (name, centre, scales, rotation, opacity, colour) in table {
        let mut poisoned = good.clone();
        push(&mut poisoned, centre, scales, rotation, opacity, colour);
        let slices = SurfelSlices::from(&poisoned);
        let (maps, tape) = forward(&slices, &camera, &config).expect("broken surfels are no error");
        assert_eq!(maps, expected, "{name}");
        let out = backward(&slices, &tape, &grads).expect("broken surfels are no error");
        assert!(all_finite(&out), "{name}");
        assert_eq!(out.centres[50], [0.0; 3], "{name}");
    }
}

#[test]
fn extreme_but_sound_surfels_stay_finite() {
    let camera = camera(30, 20);
    let p = camera.unproject(glam::DVec2::new(15.0, 10.0), 1.0).as_vec3().to_array();
    let grads = map_grads(30, 20, 1);
    for scales in [[1e-30, 1e-30], [1e-45, 1.0], [1e-20, 0.3], [0.3, 1e-9], [1e6, 1e-6], [1e30, 1e30]] {
        for rotation in [[1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [1e-9, 2e-9, 0.0, 1e-9], [1e30, 1e30, 0.0, 1e30]] {
            for opacity in [1.0 / 255.0, 1.0, 1e30] {
                let mut scene = surfels(&camera, 20, 0, 2);
                push(&mut scene, p, scales, rotation, opacity, 1.0);
                let slices = SurfelSlices::from(&scene);
                let (maps, tape) = forward(&slices, &camera, &RenderConfig::default()).expect("no error");
                let sound = |v: &f32| v.is_finite();
                assert!(maps.alpha.as_slice().iter().all(|a| (0.0..=1.0).contains(a)));
                assert!(maps.colour.as_slice().as_flattened().iter().all(sound));
                assert!(maps.depth_sum.as_slice().iter().all(sound) && maps.distortion.as_slice().iter().all(sound));
                assert!(all_finite(&backward(&slices, &tape, &grads).expect("no error")), "{scales:?} {rotation:?}");
            }
        }
    }
}

#[test]
fn a_million_surfels_on_one_pixel() {
    let camera = camera(200, 160);
    let p = camera.unproject(glam::DVec2::new(30.5, 20.5), 1.5).as_vec3().to_array();
    // Face-on, so that even a disc far wider than the image stays in front of the camera.
    let facing = glam::DQuat::from_mat3(&camera.camera_from_world.rotation.transpose()).as_quat();
    for (scale, opacity) in [(1e-4, 0.9), (1e-4, 0.0041), (10.0, 0.9)] {
        let mut crowd = Surfels::default();
        for _ in 0..1_000_000 {
            push(&mut crowd, p, [scale; 2], [facing.w, facing.x, facing.y, facing.z], opacity, 0.3);
        }
        let slices = SurfelSlices::from(&crowd);
        let (maps, tape) = forward(&slices, &camera, &RenderConfig::default()).expect("no error");
        assert!(maps.alpha[(30, 20)] > 0.99);
        let out = backward(&slices, &tape, &map_grads(200, 160, 3)).expect("no error");
        assert!(all_finite(&out));
    }
}

#[test]
fn empty_sets_and_empty_images_render() {
    let camera = camera(20, 10);
    let none = Surfels::default();
    let config = RenderConfig { background: [0.25, 0.5, 0.75], ..RenderConfig::default() };
    let maps = render(&SurfelSlices::from(&none), &camera, &config).expect("nothing to see is no error");
    assert!(maps.colour.as_slice().iter().all(|&c| c == [0.25, 0.5, 0.75]));
    let no_pixels = surfel_core::Camera { width: 0, height: 0, ..camera };
    let scene = surfels(&camera, 5, 0, 1);
    assert!(render(&SurfelSlices::from(&scene), &no_pixels, &config).expect("no error").alpha.is_empty());
}

#[test]
fn calls_that_make_no_sense_are_refused_with_the_reason() {
    let camera = camera(20, 10);
    let scene = surfels(&camera, 5, 1, 1);
    let slices = SurfelSlices::from(&scene);
    let config = RenderConfig::default();
    let short = SurfelSlices { scales: &slices.scales[..4], ..slices };
    assert!(matches!(render(&short, &camera, &config), Err(RasterError::Length { array: "scales", .. })));
    let degree = SurfelSlices { sh_degree: 4, ..slices };
    assert_eq!(render(&degree, &camera, &config), Err(RasterError::ShDegree(4)));
    let mut blind = camera;
    blind.intrinsics.fx = 0.0;
    assert!(matches!(render(&slices, &blind, &config), Err(RasterError::Camera { .. })));
    let inverted = RenderConfig { dist_far: 0.1, ..config };
    assert!(matches!(render(&slices, &camera, &inverted), Err(RasterError::Config { field: "dist_far", .. })));
    let (_, tape) = forward(&slices, &camera, &config).expect("a sound scene");
    assert!(matches!(backward(&slices, &tape, &map_grads(10, 20, 1)), Err(RasterError::GradientSize { .. })));
    let mut nan = map_grads(20, 10, 1);
    if let Some(depth) = &mut nan.depth_sum {
        depth.as_mut_slice()[7] = f32::NAN;
    }
    assert!(matches!(backward(&slices, &tape, &nan), Err(RasterError::GradientValue { map: "depth_sum", x: 7, y: 0 })));
}
