//! Surfel adaptation (paper: `SurfelAdaption`; spec 1.9.3, 2.7.3): widen each surfel until the views that
//! see it sample it twice per period.
//!
//! Invariant: afterwards `surfel_core::nyquist::frequency_ratio` is at most `2 / (pi s)` for every surfel.

use super::{Shapes, is_near_image};
use crate::config::NyquistConfig;
use glam::DVec3;
use rayon::prelude::*;
use surfel_core::Camera;
use surfel_core::nyquist::{self, NyquistMode};

/// What adaptation found, one entry per surfel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Adaptation {
    /// Sampling rate of the finest view that sees the surfel, pixels per scene unit.
    pub rates: Vec<f64>,
    /// Scales after low-pass filtering, scene units.
    pub scales: Vec<[f64; 2]>,
}

/// Rates and widened scales; `targets` lists for each home view the views its surfels are seen by, itself first.
pub fn adapt(
    shapes: &Shapes,
    cameras: &[Camera],
    targets: &[Vec<usize>],
    near_clips: &[f64],
    config: &NyquistConfig,
) -> Adaptation {
    let per_view = shapes.centres.len() / targets.len().max(1);
    let (rates, scales) = (0..shapes.centres.len())
        .into_par_iter()
        .map(|k| {
            let home = k / per_view;
            let centre = DVec3::from(shapes.centres[k].map(f64::from));
            let rates = targets[home].iter().filter_map(|&view| {
                let camera = &cameras[view];
                let z = if view == home {
                    Some(camera.camera_from_world.transform(centre).z)
                } else {
                    is_near_image(camera, centre, near_clips[view], config.visibility_margin)
                };
                let k = camera.intrinsics;
                z.map(|z| nyquist::sampling_rate(NyquistMode::Consistent, k.fx, k.fy, z))
            });
            let rate = nyquist::multi_view_rate(rates);
            let scales = shapes.scales[k].map(f64::from);
            (rate, scales.map(|scale| nyquist::adapt(NyquistMode::Consistent, scale, rate, config.s)))
        })
        .unzip();
    Adaptation { rates, scales }
}
