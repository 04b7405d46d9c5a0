//! The plane sweep over one band of rows: the inner loops of [`crate::cost_volume`].
//!
//! For every candidate the sources are warped to the rows of the band, correlated and turned into costs; eight
//! candidates at a time are then written pixel by pixel. Invariant: the costs do not depend on where bands are
//! cut, but for the rounding of the running sums of the correlation.

use crate::candidates::Candidates;
use crate::config::CostWeights;
use crate::cost_volume::{CANDIDATE_LANES, COST_ONE, COST_PADDING, COST_UNKNOWN, MatchImage};
use crate::feature_costs::FeatureCosts;
use crate::packed::{MID_GREY, PackedImage, RowWarp, SampleRow};
use crate::vector::{MAX_LANES, whole};
use crate::warp::Warp;
use crate::zncc::{ColumnSums, ReferenceWindows};
use pulp::{Arch, Simd, WithSimd};
use surfel_core::Grid;

/// Candidates written at once.
const GROUP: usize = 8;

/// All that a band reads.
pub struct Sweep<'a> {
    pub reference: Reference,
    pub sources: Vec<Source>,
    pub candidates: Candidates,
    pub weights: &'a CostWeights,
}

/// The photograph whose depth is sought.
pub struct Reference {
    width: usize,
    height: usize,
    /// Width padded to whole vectors.
    padded: usize,
    /// Luma relative to mid-grey, `[height][padded]`.
    luma: Vec<f32>,
    small: ReferenceWindows,
    wide: ReferenceWindows,
}

/// A photograph it is compared with.
pub struct Source {
    image: PackedImage,
    warp: Warp,
    features: Option<FeatureCosts>,
}

impl Reference {
    pub fn new(gray: &Grid<f32>, weights: &CostWeights) -> Self {
        let (width, height) = (gray.width(), gray.height());
        let padded = width.next_multiple_of(MAX_LANES);
        let mut luma = vec![0.0; padded * height];
        for (y, row) in luma.chunks_exact_mut(padded).enumerate() {
            row.iter_mut().zip(gray.row(y)).for_each(|(out, value)| *out = value - MID_GREY);
        }
        let windows = |radius: usize| ReferenceWindows::new(&luma, width, radius);
        let (small, wide) = (windows(weights.small_radius), windows(weights.wide_radius));
        Self { width, height, padded, luma, small, wide }
    }
}

impl Source {
    pub fn new(reference: &MatchImage, source: &MatchImage, candidates: &Candidates) -> Self {
        let warp = Warp::new(reference.camera, source.camera);
        let size = (reference.gray.width(), reference.gray.height());
        let features =
            reference.features.zip(source.features).map(|(a, b)| FeatureCosts::sweep(&a, &b, &warp, candidates, size));
        Self { image: PackedImage::new(source.gray, source.valid), warp, features }
    }
}

/// Scratch of one task.
#[derive(Default)]
pub struct Band {
    score: ScoreScratch,
    /// Costs in \[0, 1\], NaN where unseen: `[source][row][padded]`.
    costs: Vec<f32>,
    per_source: Vec<f32>,
    /// `[row][GROUP][padded]`.
    tile: Vec<i16>,
}

impl Band {
    /// Costs of the rows from `first_row` on, `[row][width][stride]`, as many as `out` holds.
    pub fn fill(&mut self, sweep: &Sweep, first_row: usize, out: &mut [i16]) {
        let Reference { width, padded, .. } = sweep.reference;
        let count = sweep.candidates.count;
        let stride = count.next_multiple_of(CANDIDATE_LANES);
        let num_rows = out.len() / (width * stride);
        let num_sources = sweep.sources.len();
        let arch = Arch::new();
        self.costs.resize(num_sources * num_rows * padded, 0.0);
        self.tile.resize(num_rows * GROUP * padded, 0);
        for group in (0..stride).step_by(GROUP) {
            for k in 0..GROUP {
                let candidate = group + k;
                if candidate < count {
                    for (source, costs) in sweep.sources.iter().zip(self.costs.chunks_exact_mut(num_rows * padded)) {
                        let scratch = &mut self.score;
                        arch.dispatch(Score { sweep, source, candidate, first_row, scratch, costs });
                    }
                }
                for row in 0..num_rows {
                    let tile = &mut self.tile[(row * GROUP + k) * padded..][..padded];
                    if candidate >= count {
                        tile.fill(COST_PADDING);
                    } else if num_sources == 1 {
                        let costs = &self.costs[row * padded..][..padded];
                        arch.dispatch(Store { costs, out: tile });
                    } else {
                        for (x, out) in tile.iter_mut().enumerate() {
                            self.per_source.clear();
                            let places = (0..num_sources).map(|s| (s * num_rows + row) * padded + x);
                            self.per_source.extend(places.map(|at| self.costs[at]));
                            *out = stored(mean_favouring_best(&mut self.per_source));
                        }
                    }
                }
            }
            for (row, out) in out.chunks_exact_mut(width * stride).enumerate() {
                let tile = &self.tile[row * GROUP * padded..][..GROUP * padded];
                let rows: [&[i16]; GROUP] = std::array::from_fn(|k| &tile[k * padded..][..width]);
                for (x, out) in out.chunks_exact_mut(stride).enumerate() {
                    out[group..][..GROUP].copy_from_slice(&rows.map(|row| row[x]));
                }
            }
        }
    }
}

/// A cost in \[0, 1\] as it is stored; NaN is "no source sees this".
#[inline(always)]
fn stored(cost: f32) -> i16 {
    if cost.is_nan() { COST_UNKNOWN } else { whole((cost * f32::from(COST_ONE)).floor()) as i16 }
}

/// Stores a row of costs.
struct Store<'a> {
    costs: &'a [f32],
    out: &'a mut [i16],
}

impl WithSimd for Store<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (out, &cost) in self.out.iter_mut().zip(self.costs) {
            *out = stored(cost);
        }
    }
}

/// Mean of the costs that exist, each counting half as much as the next better one: a source that sees an
/// occluder hardly spoils the others, and none is wasted. NaN when none exists.
fn mean_favouring_best(costs: &mut [f32]) -> f32 {
    costs.sort_by(f32::total_cmp);
    let (mut sum, mut total, mut weight) = (0.0f32, 0.0f32, 1.0f32);
    for cost in costs.iter().take_while(|cost| !cost.is_nan()) {
        sum += weight * cost;
        total += weight;
        weight *= 0.5;
    }
    sum / total
}

/// Scratch of the costs of one source at one candidate.
#[derive(Default)]
struct ScoreScratch {
    w: Vec<f32>,
    samples: SampleRow,
    /// `[halo + rows + halo][padded]`, zero in the padding.
    warped: Vec<f32>,
    seen: Vec<u32>,
    small: ColumnSums,
    wide: ColumnSums,
    /// Feature costs of the feature rows of the band, at the columns of the reference.
    feature_rows: Vec<f32>,
}

/// Costs of one source at one candidate over a band.
struct Score<'a> {
    sweep: &'a Sweep<'a>,
    source: &'a Source,
    candidate: usize,
    first_row: usize,
    scratch: &'a mut ScoreScratch,
    /// `[row][padded]`.
    costs: &'a mut [f32],
}

/// Plain loops over rows, compiled for the vectors of every instruction set.
impl WithSimd for Score<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { sweep, source, candidate, first_row, scratch, costs } = self;
        let Reference { width, height, padded, ref luma, ref small, ref wide } = sweep.reference;
        let num_rows = costs.len() / padded;
        let halo = small.radius.max(wide.radius);
        scratch.warped.resize((num_rows + 2 * halo) * padded, 0.0);
        scratch.seen.resize((num_rows + 2 * halo) * padded, 0);
        scratch.w.clear();
        scratch.w.resize(width, sweep.candidates.inverse_depth(candidate as f64) as f32);
        // Rows beyond the image repeat its border.
        let reference_row = |row: usize| (first_row + row).saturating_sub(halo).min(height - 1);
        for row in 0..num_rows + 2 * halo {
            let warp = RowWarp::new(&source.warp, reference_row(row));
            let (warped, seen) = (&mut scratch.warped[row * padded..], &mut scratch.seen[row * padded..]);
            source.image.sample_row(&warp, &scratch.w, &mut scratch.samples, warped, seen);
        }
        let weights = sweep.weights;
        let feature_weight = if source.features.is_some() { weights.features } else { 0.0 };
        let mut first_feature_row = 0;
        if let Some(features) = &source.features {
            first_feature_row = features.row_tap(first_row).first;
            let last = features.row_tap(first_row + num_rows - 1).second;
            scratch.feature_rows.resize((last + 1 - first_feature_row) * padded, 0.0);
            for (i, out) in scratch.feature_rows.chunks_exact_mut(padded).enumerate() {
                features.widened(first_feature_row + i, candidate, &mut out[..width]);
            }
        }
        let pair = |row: usize| (&luma[reference_row(row) * padded..][..padded], row * padded);
        for (sums, windows) in [(&mut scratch.small, small), (&mut scratch.wide, wide)] {
            sums.clear(padded, windows.radius);
            for row in halo - windows.radius..halo + windows.radius {
                let (a, b) = pair(row);
                sums.enter(a, &scratch.warped[b..][..padded]);
            }
        }
        let inverse = 1.0 / (weights.small + weights.wide + feature_weight);
        for (row, cost) in costs.chunks_exact_mut(padded).enumerate() {
            let y = first_row + row;
            match &source.features {
                None => cost.fill(weights.small + weights.wide),
                Some(features) => {
                    let tap = features.row_tap(y);
                    let row_of = |y: usize| &scratch.feature_rows[(y - first_feature_row) * padded..][..padded];
                    let (base, pairs) =
                        (weights.small + weights.wide, row_of(tap.first).iter().zip(row_of(tap.second)));
                    for (cost, (first, second)) in cost.iter_mut().zip(pairs) {
                        *cost = base + feature_weight * (first + (second - first) * tap.t);
                    }
                }
            }
            for (sums, windows, weight) in
                [(&mut scratch.small, small, weights.small), (&mut scratch.wide, wide, weights.wide)]
            {
                let (a, b) = pair(row + halo + windows.radius);
                sums.enter(a, &scratch.warped[b..][..padded]);
                sums.correlate(windows, y, weight, cost);
                let (a, b) = pair(row + halo - windows.radius);
                sums.leave(a, &scratch.warped[b..][..padded]);
            }
            let seen = &scratch.seen[(row + halo) * padded..][..padded];
            for (cost, &seen) in cost.iter_mut().zip(seen) {
                *cost = if seen == 1 { (0.5 * *cost * inverse).clamp(0.0, 1.0) } else { f32::NAN };
            }
        }
    }
}
