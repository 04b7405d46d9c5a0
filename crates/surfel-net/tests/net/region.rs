//! Footprint regions against a search over all pixels, and adaptation's guarantee.

use glam::{DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use std::f64::consts::PI;
use surfel_core::nyquist::frequency_ratio;
use surfel_core::{Camera, Intrinsics, Rigid};
use surfel_net::config::NyquistConfig;
use surfel_net::nyquist::{Shapes, adapt::adapt, region::regions};
use surfel_net::{NetConfig, Preset};
use surfel_raster::pixel_camera::PixelCamera;
use surfel_raster::ray_splat::Footprint;
use surfel_raster::slices::SurfelShape;

const WIDTH: usize = 24;
const HEIGHT: usize = 18;

fn cameras(unit: f64) -> Vec<Camera> {
    let camera = |angle: f64, x: f64| Camera {
        intrinsics: Intrinsics { fx: 30.0, fy: 29.0, cx: 12.3, cy: 8.8 },
        width: WIDTH,
        height: HEIGHT,
        camera_from_world: Rigid::from_quat(DQuat::from_rotation_y(angle), DVec3::new(x, 0.05, 0.1) * unit),
    };
    vec![camera(0.0, 0.0), camera(0.15, -0.6)]
}

/// A surfel on the ray of every pixel of both views, in all orientations and from far below to above a pixel.
fn shapes(unit: f64, log_scales: std::ops::Range<f64>) -> Shapes {
    let mut rng = StdRng::seed_from_u64(3);
    let mut shapes = Shapes::default();
    for camera in cameras(unit) {
        for i in 0..WIDTH * HEIGHT {
            let depth = rng.random_range(2.0..5.0) * unit;
            let centre = camera.unproject(Camera::pixel_centre(i % WIDTH, i / WIDTH), depth);
            let pixel = depth / 30.0;
            shapes.centres.push(centre.as_vec3().to_array());
            shapes.scales.push([(); 2].map(|()| (pixel * rng.random_range(log_scales.clone()).exp()) as f32));
            shapes.rotations.push(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        }
    }
    shapes
}

fn config() -> NyquistConfig {
    NyquistConfig { radius: 3, ..NetConfig::preset(Preset::Tiny).nyquist }
}

const TARGETS: [[usize; 2]; 2] = [[0, 1], [1, 0]];

fn targets() -> Vec<Vec<usize>> {
    TARGETS.iter().map(|t| t.to_vec()).collect()
}

#[test]
fn after_adaptation_every_view_samples_often_enough() {
    for s in [2.0 / PI, 1.0, 1.7] {
        let shapes = shapes(1.0, -4.0..2.0);
        let config = NyquistConfig { s, ..config() };
        let adaptation = adapt(&shapes, &cameras(1.0), &targets(), &[1e-3; 2], &config);
        let mut violated_before = 0;
        for (k, rate) in adaptation.rates.iter().enumerate() {
            for axis in 0..2 {
                violated_before += usize::from(frequency_ratio(f64::from(shapes.scales[k][axis]), *rate) > 1.0);
                let after = frequency_ratio(adaptation.scales[k][axis], *rate);
                assert!(after <= 2.0 / (PI * s) + 1e-12, "{after} at s = {s}");
            }
        }
        assert!(violated_before > 100, "the scene tests nothing");
    }
}

#[test]
fn regions_hold_exactly_the_pixels_that_see_the_surfel() {
    let (shapes, config, cameras) = (shapes(1.0, -3.0..0.0), config(), cameras(1.0));
    let scales: Vec<[f64; 2]> = shapes.scales.iter().map(|s| s.map(f64::from)).collect();
    let regions = regions(&shapes, &scales, &cameras, &targets(), &[1e-3; 2], &config);
    let pixel_cameras: Vec<PixelCamera> = cameras.iter().map(|c| PixelCamera::new(c).unwrap()).collect();
    let (mut compared, mut sampled) = (0, 0);
    for k in 0..shapes.centres.len() {
        let home = k / (WIDTH * HEIGHT);
        let mut found = Vec::new();
        regions.pixels(k, &mut found);
        found.sort_unstable();
        assert!(found.contains(&k), "surfel {k} does not see its own pixel");
        let windows = &regions.windows[2 * k..2 * k + 2];
        if windows.iter().any(|w| w.step > 1) {
            continue;
        }
        let shape = SurfelShape {
            centre: DVec3::from(shapes.centres[k].map(f64::from)),
            scales: DVec2::from(scales[k]),
            rotation: shapes.rotations[k].map(f64::from),
            opacity: 1.0,
        };
        let mut expected = Vec::new();
        for view in TARGETS[home] {
            let Some((pixel, _)) = cameras[view].project(shape.centre) else { continue };
            let Some(footprint) = Footprint::of(&pixel_cameras[view], &shape, 1e-3, 3.0) else { continue };
            for i in (0..WIDTH * HEIGHT).filter(|_| view == home || cameras[view].contains(pixel)) {
                if footprint.value((i % WIDTH) as f64, (i / WIDTH) as f64) > config.epsilon {
                    expected.push(view * WIDTH * HEIGHT + i);
                }
            }
        }
        expected.sort_unstable();
        assert_eq!(found, expected, "surfel {k}");
        compared += 1;
        sampled += found.len();
    }
    assert!(compared > shapes.centres.len() / 2 && sampled > 8 * compared, "{sampled} pixels of {compared} surfels");
}

#[test]
fn large_footprints_are_sampled_sparsely_and_regions_know_no_unit() {
    let large = shapes(1.0, 1.0..2.5);
    let config = config();
    let of = |shapes: &Shapes, unit: f64| {
        let adaptation = adapt(shapes, &cameras(unit), &targets(), &[1e-3 * unit; 2], &config);
        regions(shapes, &adaptation.scales, &cameras(unit), &targets(), &[1e-3 * unit; 2], &config)
    };
    let metres = of(&large, 1.0);
    assert!(metres.windows.iter().filter(|w| w.step > 1).count() > metres.windows.len() / 4);
    assert!(metres.windows.iter().all(|w| w.mask.count_ones() <= 49));
    // A power of two, so that scaling rounds nothing.
    let doubled = |mut shapes: Shapes| {
        shapes.centres.iter_mut().flatten().for_each(|v| *v *= 256.0);
        shapes.scales.iter_mut().flatten().for_each(|v| *v *= 256.0);
        shapes
    };
    let same = of(&doubled(large), 256.0);
    let differing = same.windows.iter().zip(&metres.windows).filter(|(a, b)| a != b).count();
    // The cameras' f64 translations scale exactly too; only products round differently.
    assert!(differing <= metres.windows.len() / 500, "{differing} of {}", metres.windows.len());
}
