//! The surface a pixel sees: against its twin, and against layers whose mean is known.

mod support;

use support::{camera, surfels};
use surfel_core::{Camera, Intrinsics, Rigid, Surfels};
use surfel_raster::twin::{self, TwinSurfels};
use surfel_raster::{RenderConfig, Surface, SurfelSlices, forward, surface};

fn surface_of(surfels: &Surfels, camera: &Camera, config: &RenderConfig, reach: f64) -> Surface {
    let (maps, tape) = forward(&SurfelSlices::from(surfels), camera, config).expect("a sound scene");
    surface(&tape, &maps.depth_median, reach)
}

#[test]
fn the_surface_equals_its_twin() {
    for (seed, centre_depth) in [(0, false), (1, true)] {
        let config = RenderConfig { centre_depth_when_lowpass: centre_depth, ..RenderConfig::default() };
        let camera = camera(57, 41);
        let surfels = surfels(&camera, 900, 0, seed);
        let fast = surface_of(&surfels, &camera, &config, 0.05);
        let slow = twin::surface(&TwinSurfels::from(&SurfelSlices::from(&surfels)), &camera, &config, 0.05);
        let slow = slow.expect("a sound scene");
        let (mut compared, mut found) = (0, 0);
        for (i, slow) in slow.as_slice().iter().enumerate().filter(|(_, slow)| slow.margin > 1e-4) {
            let depth = f64::from(fast.depth.as_slice()[i]);
            assert!((depth - slow.depth).abs() <= 2e-5 * slow.depth, "pixel {i}: {depth} and {}", slow.depth);
            let turned = (0..3).map(|c| (f64::from(fast.normal.as_slice()[i][c]) - slow.normal[c]).abs());
            assert!(turned.fold(0.0, f64::max) < 1e-3, "pixel {i}");
            compared += 1;
            found += usize::from(slow.depth > 0.0);
        }
        assert!(compared > 57 * 41 / 3 && found > compared / 2, "{compared} compared, {found} found");
    }
}

/// Broad discs facing the camera, one at each depth.
fn discs(depths: &[f32]) -> (Surfels, Camera) {
    let intrinsics = Intrinsics { fx: 20.0, fy: 20.0, cx: 8.0, cy: 8.0 };
    let camera = Camera { intrinsics, width: 16, height: 16, camera_from_world: Rigid::IDENTITY };
    let count = depths.len();
    let surfels = Surfels {
        centres: depths.iter().map(|z| [0.0, 0.0, *z]).collect(),
        scales: vec![[4.0, 4.0]; count],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; count],
        opacities: vec![0.9; count],
        sh: vec![[0.0; 3]; count],
        sh_degree: 0,
    };
    (surfels, camera)
}

#[test]
fn layers_within_reach_are_averaged_whatever_their_order_and_others_have_no_say() {
    let inverse = |depths: &[f32]| depths.iter().map(|z| 1.0 / z).sum::<f32>() / depths.len() as f32;
    for order in [[2.0, 2.02, 2.04, 3.0], [3.0, 2.04, 2.0, 2.02]] {
        let (surfels, camera) = discs(&order);
        let found = surface_of(&surfels, &camera, &RenderConfig::default(), 0.015).depth[(8, 8)];
        // Two of the median's three neighbours in depth are within reach; the disc at 3 is not.
        let expected = 1.0 / inverse(&[2.0, 2.02, 2.04]);
        assert!((found - expected).abs() < 1e-4, "{found} instead of {expected}");
    }
    let (surfels, camera) = discs(&[2.0, 3.0]);
    assert!((surface_of(&surfels, &camera, &RenderConfig::default(), 0.01).depth[(8, 8)] - 2.0).abs() < 1e-5);
    let nothing = surface_of(&Surfels::default(), &camera, &RenderConfig::default(), 0.01);
    assert!(nothing.depth.as_slice().iter().all(|z| *z == 0.0));
    assert!(nothing.normal.as_slice().iter().all(|n| *n == [0.0; 3]));
}

#[test]
fn noise_does_not_draw_the_surface_to_the_camera() {
    // Forty discs whose inverse depths scatter evenly about 1 / 2: the median lies before them, their mean does not.
    let depths: Vec<f32> = (0..40).map(|i| 1.0 / (0.5 + 0.001 * ((i * 17 % 40) as f32 - 19.5))).collect();
    let (surfels, camera) = discs(&depths);
    let config = RenderConfig::default();
    let (maps, tape) = forward(&SurfelSlices::from(&surfels), &camera, &config).expect("a sound scene");
    let (median, mean) = (maps.depth_median[(8, 8)], surface(&tape, &maps.depth_median, 0.05).depth[(8, 8)]);
    assert!(median < 1.95 && (mean - 2.0).abs() < 0.002, "median {median}, mean {mean}");
}
