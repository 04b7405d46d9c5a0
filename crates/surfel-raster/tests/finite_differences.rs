//! The twin's gradients against central differences in f64, for every parameter and both branches.

mod support;

use support::{camera, loss, map_grads, surfels};
use surfel_core::Camera;
use surfel_raster::twin::{self, TwinSurfels};
use surfel_raster::{MapGrads, RenderConfig, SurfelSlices};

fn loss_of(surfels: &TwinSurfels, camera: &Camera, config: &RenderConfig, grads: &MapGrads) -> f64 {
    loss(&twin::render(surfels, camera, config).expect("a sound scene"), grads)
}

/// Central difference, or `None` when a decision tips over between the two steps: then halving the step changes
/// the answer.
fn difference(
    surfels: &TwinSurfels,
    (camera, config, grads): (&Camera, &RenderConfig, &MapGrads),
    step: f64,
    parameter: impl Fn(&mut TwinSurfels) -> &mut f64,
) -> Option<f64> {
    let slope = |h: f64| {
        let at = |h: f64| {
            let mut moved = surfels.clone();
            *parameter(&mut moved) += h;
            loss_of(&moved, camera, config, grads)
        };
        (at(h) - at(-h)) / (2.0 * h)
    };
    let (coarse, fine) = (slope(step), slope(step / 2.0));
    ((coarse - fine).abs() <= 1e-4 * fine.abs().max(1e-2)).then_some(fine)
}

/// Checks every parameter; returns how many differences were usable out of how many.
fn check(config: &RenderConfig, count: usize, sh_degree: usize, seed: u64) -> (usize, usize) {
    let camera = camera(14, 11);
    let scene = surfels(&camera, count, sh_degree, seed);
    let surfels = TwinSurfels::from(&SurfelSlices::from(&scene));
    let grads = map_grads(camera.width, camera.height, seed + 100);
    let analytic = twin::backward(&surfels, &camera, config, &grads).expect("a sound scene");
    let setting = (&camera, config, &grads);
    let (mut usable, mut total) = (0, 0);
    let mut verify = |name: &str, k: usize, found: f64, expected: Option<f64>| {
        total += 1;
        let Some(expected) = expected else { return };
        usable += 1;
        let tolerance = 2e-4 * expected.abs().max(1e-1);
        assert!(
            (found - expected).abs() <= tolerance,
            "seed {seed}, {name} of {k}: {found}, differences say {expected}"
        );
    };
    for k in 0..count {
        let scale = surfels.shapes[k].scales.min_element();
        for i in 0..3 {
            let expected = difference(&surfels, setting, 1e-5 * scale, |s| &mut s.shapes[k].centre[i]);
            verify("centre", k, analytic.shapes[k].centre[i], expected);
        }
        for i in 0..2 {
            let expected = difference(&surfels, setting, 1e-5 * scale, |s| &mut s.shapes[k].scales[i]);
            verify("scale", k, analytic.shapes[k].scales[i], expected);
        }
        for i in 0..4 {
            let expected = difference(&surfels, setting, 1e-6, |s| &mut s.shapes[k].rotation[i]);
            verify("rotation", k, analytic.shapes[k].rotation[i], expected);
        }
        let expected = difference(&surfels, setting, 1e-6, |s| &mut s.shapes[k].opacity);
        verify("opacity", k, analytic.shapes[k].opacity, expected);
        for n in 0..analytic.sh[k].len() {
            for c in 0..3 {
                let expected = difference(&surfels, setting, 1e-6, |s| &mut s.sh[k][n][c]);
                verify("sh", k, analytic.sh[k][n][c], expected);
            }
        }
    }
    (usable, total)
}

fn check_scenes(config: &RenderConfig) {
    let (mut usable, mut total) = (0, 0);
    for seed in 0..12 {
        let (u, t) = check(config, 4 + seed as usize % 5, seed as usize % 4, seed);
        usable += u;
        total += t;
    }
    eprintln!("{usable} of {total} differences usable");
    assert!(usable * 10 >= total * 8, "only {usable} of {total} differences were usable");
}

#[test]
fn exact_gradients() {
    check_scenes(&RenderConfig {
        background: [0.4, 0.1, 0.8],
        dist_near: 0.5,
        dist_far: 6.0,
        ..RenderConfig::default()
    });
}

#[test]
fn exact_gradients_with_centre_depth() {
    check_scenes(&RenderConfig {
        centre_depth_when_lowpass: true,
        dist_near: 0.5,
        dist_far: 6.0,
        ..RenderConfig::default()
    });
}

#[test]
fn both_branches_are_exercised() {
    let camera = camera(14, 11);
    let pixel_camera = surfel_raster::pixel_camera::PixelCamera::new(&camera).expect("a sound camera");
    let (mut surfel, mut lowpass) = (0, 0);
    for seed in 0..12 {
        let scene = surfels(&camera, 4 + seed as usize % 5, 0, seed);
        for shape in TwinSurfels::from(&SurfelSlices::from(&scene)).shapes {
            let Some(footprint) = surfel_raster::Footprint::of(&pixel_camera, &shape, 0.2, 3.0) else { continue };
            for y in 0..camera.height {
                for x in 0..camera.width {
                    match footprint.hit(x as f64, y as f64) {
                        Some(hit) if hit.rho() > 5.0 => {}
                        Some(hit) if hit.surfel_wins() => surfel += 1,
                        _ => lowpass += 1,
                    }
                }
            }
        }
    }
    assert!(surfel > 100 && lowpass > 50, "{surfel} surfel hits, {lowpass} low-pass hits");
}
