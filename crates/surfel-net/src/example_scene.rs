//! A scene of two views that needs no file: what devices are checked, costs counted and benches run on.
//!
//! Invariant: a function of its size alone.

use crate::cost_volume::DepthRange;
use crate::input::SceneInput;
use crate::seed::Seed;
use glam::{DQuat, DVec3};
use surfel_core::{Camera, Grid, Intrinsics, Rigid};

/// Two photographs of a slanted plane about two units away, as matching would have found it.
pub struct ExampleScene {
    images: [Grid<[f32; 3]>; 2],
    cameras: [Camera; 2],
    ranges: [DepthRange; 2],
    seeds: [Seed; 2],
}

impl ExampleScene {
    /// Of this size, pixels.
    pub fn new(width: usize, height: usize) -> Self {
        let image = |v: usize| {
            Grid::from_fn(width, height, |x, y| [0.1, 0.2, 0.3].map(|c| (c * (x + y * 2 + v * 5) as f32).sin().abs()))
        };
        let map = |value| Grid::filled(width, height, value);
        let planes = Grid::from_fn(width, height, |x, y| [0.4 + 2e-4 * x as f32 + 1e-4 * y as f32, 2e-4, 1e-4]);
        let evidence = planes.map(|[w, ..]| [w + 1e-3, 1.0]);
        let seed = Seed { planes, evidence, correlation: map(0.8), confidence: map(0.9), step: 5e-3 };
        Self {
            images: [0, 1].map(image),
            cameras: cameras(width, height),
            ranges: [DepthRange { near: 1.0, far: 5.0 }; 2],
            seeds: [seed.clone(), seed],
        }
    }

    /// What a network is given of it; only one that is seeded wants seeds.
    pub fn input(&self, seeded: bool) -> SceneInput<'_> {
        let seeds = if seeded { &self.seeds[..] } else { &[] };
        SceneInput { images: &self.images, cameras: &self.cameras, ranges: &self.ranges, seeds }
    }
}

/// Two cameras that look at the same things, of this size in pixels.
pub fn cameras(width: usize, height: usize) -> [Camera; 2] {
    let (cx, cy) = (0.5 * width as f64, 0.5 * height as f64);
    let camera = |v: usize| Camera {
        intrinsics: Intrinsics { fx: 1.1 * width as f64, fy: 1.1 * width as f64, cx, cy },
        width,
        height,
        camera_from_world: Rigid::from_quat(
            DQuat::from_rotation_y(0.1 * v as f64),
            DVec3::new(-0.4, 0.0, 0.0) * v as f64,
        ),
    };
    [camera(0), camera(1)]
}
