//! The matching cost of every pixel at every depth candidate.
//!
//! Photometric (ZNCC in a small and a wider window at full resolution) and, when given, learned features
//! at a quarter of it. Costs are `i16`, [`COST_ONE`] = certain mismatch, candidates contiguous per pixel.
//! Invariant: a pixel outside every source view costs [`COST_UNKNOWN`] at that candidate, neither a match
//! nor a refusal, so that aggregation decides.

use crate::band::{Band, Reference, Source, Sweep};
use crate::candidates::Candidates;
use crate::config::CostWeights;
use crate::feature_costs::FeatureGrid;
use rayon::prelude::*;
use surfel_core::{Camera, Grid};

/// Cost of correlation -1.
pub const COST_ONE: i16 = 1000;
/// Cost of "no source sees this".
pub const COST_UNKNOWN: i16 = 450;
/// Cost of the candidates that only fill a pixel up to whole vectors: never chosen.
pub const COST_PADDING: i16 = 8000;

/// Candidates of a pixel are padded to a multiple of this: the most `i16` lanes any instruction set has.
pub const CANDIDATE_LANES: usize = 32;

/// Rows a task computes at once: large enough that the window halo is cheap, small enough for the cache.
const BAND_ROWS: usize = 32;

/// One photograph prepared for matching.
#[derive(Clone, Copy, Debug)]
pub struct MatchImage<'a> {
    /// Luma.
    pub gray: &'a Grid<f32>,
    /// Pixels that show the scene.
    pub valid: &'a Grid<bool>,
    /// Camera of `gray`.
    pub camera: &'a Camera,
    /// Learned features, if any.
    pub features: Option<FeatureGrid<'a>>,
}

/// Costs `[height][width][stride]`, of which the first [`Candidates::count`] of every pixel are meant.
pub struct CostVolume {
    /// Reference columns.
    pub width: usize,
    /// Reference rows.
    pub height: usize,
    /// The candidates along the last axis.
    pub candidates: Candidates,
    costs: Vec<i16>,
}

impl CostVolume {
    /// A volume of `cost(x, y, candidate)`.
    pub fn from_fn(
        (width, height): (usize, usize),
        candidates: Candidates,
        mut cost: impl FnMut(usize, usize, usize) -> i16,
    ) -> Self {
        let stride = stride_of(&candidates);
        let mut costs = vec![COST_PADDING; width * height * stride];
        for (pixel, costs) in costs.chunks_exact_mut(stride).enumerate() {
            for (j, out) in costs[..candidates.count].iter_mut().enumerate() {
                *out = cost(pixel % width, pixel / width, j);
            }
        }
        Self { width, height, candidates, costs }
    }

    /// Sweeps the candidates for `reference` against all `sources`, of which there is at least one.
    pub fn sweep(
        reference: &MatchImage,
        sources: &[MatchImage],
        candidates: Candidates,
        weights: &CostWeights,
    ) -> Self {
        let (width, height, stride) = (reference.gray.width(), reference.gray.height(), stride_of(&candidates));
        let sweep = Sweep {
            reference: Reference::new(reference.gray, weights),
            sources: sources.iter().map(|source| Source::new(reference, source, &candidates)).collect(),
            candidates,
            weights,
        };
        let mut costs = vec![0; width * height * stride];
        costs.par_chunks_mut(BAND_ROWS * width * stride).enumerate().for_each_init(Band::default, |band, (i, out)| {
            band.fill(&sweep, i * BAND_ROWS, out);
        });
        Self { width, height, candidates, costs }
    }

    /// Costs of one pixel over the candidates.
    pub fn at(&self, x: usize, y: usize) -> &[i16] {
        &self.padded_at(x, y)[..self.candidates.count]
    }

    /// Costs of one pixel, padded to whole vectors with [`COST_PADDING`].
    pub fn padded_at(&self, x: usize, y: usize) -> &[i16] {
        let stride = self.stride();
        &self.costs[(y * self.width + x) * stride..][..stride]
    }

    /// Distance between the costs of neighbouring pixels.
    pub fn stride(&self) -> usize {
        stride_of(&self.candidates)
    }
}

fn stride_of(candidates: &Candidates) -> usize {
    candidates.count.next_multiple_of(CANDIDATE_LANES)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin;
    use glam::{DQuat, DVec3};
    use surfel_core::{Intrinsics, Rigid};

    #[test]
    fn equals_the_twin() {
        let (width, height, channels) = (45, 37, 11);
        let camera = |rotation, translation| Camera {
            intrinsics: Intrinsics { fx: 50.0, fy: 51.0, cx: 23.0, cy: 18.0 },
            width,
            height,
            camera_from_world: Rigid::from_quat(rotation, translation),
        };
        let cameras = [
            camera(DQuat::IDENTITY, DVec3::ZERO),
            camera(DQuat::from_rotation_y(0.1), DVec3::new(-0.3, 0.02, 0.1)),
            camera(DQuat::from_rotation_x(0.05), DVec3::new(0.05, 0.4, -0.1)),
        ];
        let noise = |x: usize, y: usize, seed: usize| ((x * 7919 + y * 104_729 + seed * 31) % 1009) as f32 / 1009.0;
        let grays = [0, 1, 2].map(|v| Grid::from_fn(width, height, |x, y| noise(x / 2, y / 2, v)));
        let valid = Grid::from_fn(width, height, |x, y| (x / 6 + y / 5) % 9 != 0);
        let (fw, fh) = (width.div_ceil(4), height.div_ceil(4));
        let data = [3, 4, 5].map(|v| (0..fw * fh * channels).map(|i| noise(i, i / 7, v) - 0.4).collect::<Vec<f32>>());
        for has_features in [false, true] {
            let image = |v: usize| MatchImage {
                gray: &grays[v],
                valid: &valid,
                camera: &cameras[v],
                features: has_features.then_some(FeatureGrid {
                    channels,
                    width: fw,
                    height: fh,
                    stride: 4.0,
                    origin: 1.5,
                    data: &data[v],
                }),
            };
            let (reference, sources) = (image(0), [image(1), image(2)]);
            let candidates = Candidates::uniform(1.0, 4.0, 19);
            let weights = CostWeights::default();
            for sources in [&sources[..1], &sources[..]] {
                let volume = CostVolume::sweep(&reference, sources, candidates, &weights);
                let (mut num_far, mut num_unknown, mut num) = (0, 0, 0);
                for (y, x) in (0..height).step_by(4).flat_map(|y| (0..width).map(move |x| (y, x))) {
                    for (j, &fast) in volume.at(x, y).iter().enumerate().step_by(3) {
                        let w = candidates.inverse_depth(j as f64);
                        let costs = sources.iter().map(|s| twin::source_cost(&reference, s, w, (x, y), &weights));
                        let mut costs: Vec<f32> = costs.flatten().collect();
                        costs.sort_by(f32::total_cmp);
                        let slow = match costs[..] {
                            [] => COST_UNKNOWN,
                            [only] => (only * 1000.0) as i16,
                            [better, worse, ..] => ((better + 0.5 * worse) / 1.5 * 1000.0) as i16,
                        };
                        num += 1;
                        num_unknown += usize::from(slow == COST_UNKNOWN);
                        num_far += usize::from((fast - slow).abs() > 2);
                    }
                    assert!(volume.padded_at(x, y)[candidates.count..].iter().all(|&c| c == COST_PADDING));
                }
                // A landing at the very edge of what a source sees may fall on either side.
                assert!(num_far * 500 < num, "{num_far} of {num} costs differ");
                assert!(num_unknown > num / 50, "the test sees everything");
            }
        }
    }
}
