//! The matching cost of every pixel at every depth candidate.
//!
//! Photometric (ZNCC in a small and a wider window at full resolution) and, when given, learned features
//! at a quarter of it. Costs are `i16`, [`COST_ONE`] = certain mismatch, candidates contiguous per pixel.
//! Invariant: a pixel outside every source view costs [`COST_UNKNOWN`] at that candidate, neither a match
//! nor a refusal, so that aggregation decides.

use crate::candidates::Candidates;
use crate::config::CostWeights;
use crate::warp::Warp;
use crate::zncc::ZnccBand;
use rayon::prelude::*;
use surfel_core::{Camera, Grid};

/// Cost of correlation -1.
pub const COST_ONE: i16 = 1000;
/// Cost of "no source sees this".
pub const COST_UNKNOWN: i16 = 450;

/// Rows a task computes at once: large enough that the window halo is cheap, small enough for the cache.
const BAND_ROWS: usize = 24;

/// Unit-length feature vectors on a coarser grid, pixel-major (`channels` values per feature pixel).
#[derive(Clone, Copy, Debug)]
pub struct FeatureGrid<'a> {
    /// Values per feature pixel.
    pub channels: usize,
    /// Feature columns.
    pub width: usize,
    /// Feature rows.
    pub height: usize,
    /// Input pixels per feature pixel.
    pub stride: f64,
    /// Input index coordinate of the centre of feature pixel 0.
    pub origin: f64,
    /// `height * width * channels` values.
    pub data: &'a [f32],
}

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

/// Costs `[height][width][candidates]`.
pub struct CostVolume {
    /// Reference columns.
    pub width: usize,
    /// Reference rows.
    pub height: usize,
    /// The candidates along the last axis.
    pub candidates: Candidates,
    /// Row-major pixels, candidates contiguous.
    pub costs: Vec<i16>,
}

impl CostVolume {
    /// Costs of one pixel over the candidates.
    pub fn at(&self, x: usize, y: usize) -> &[i16] {
        let n = self.candidates.count;
        &self.costs[(y * self.width + x) * n..][..n]
    }

    /// Sweeps the candidates for `reference` against all `sources`.
    pub fn sweep(
        reference: &MatchImage,
        sources: &[MatchImage],
        candidates: Candidates,
        weights: &CostWeights,
    ) -> Self {
        let (width, height, n) = (reference.gray.width(), reference.gray.height(), candidates.count);
        let warps: Vec<Warp> = sources.iter().map(|s| Warp::new(reference.camera, s.camera)).collect();
        let feature_costs: Vec<Option<FeatureCosts>> =
            sources.iter().zip(&warps).map(|(s, warp)| FeatureCosts::sweep(reference, s, warp, &candidates)).collect();
        let mut costs = vec![COST_UNKNOWN; width * height * n];
        costs.par_chunks_mut(BAND_ROWS * width * n).enumerate().for_each_init(Band::default, |band, (index, out)| {
            let rows = index * BAND_ROWS..(index * BAND_ROWS + out.len() / (width * n));
            for j in 0..n {
                let w = candidates.inverse_depth(j as f64);
                band.total.clear();
                band.total.resize(rows.len() * width * sources.len(), f32::NAN);
                for (s, source) in sources.iter().enumerate() {
                    let features = feature_costs[s].as_ref().map(|f| (f, j));
                    band.score(reference, source, &warps[s], w, rows.clone(), weights, features, s, sources.len());
                }
                for (pixel, per_source) in band.total.chunks_exact_mut(sources.len()).enumerate() {
                    if let Some(cost) = mean_favouring_best(per_source) {
                        out[pixel * n + j] = (cost * f32::from(COST_ONE)) as i16;
                    }
                }
            }
        });
        Self { width, height, candidates, costs }
    }
}

/// Mean of the costs that exist, each counting half as much as the next better one: a source that sees an
/// occluder hardly spoils the others, and none is wasted.
fn mean_favouring_best(costs: &mut [f32]) -> Option<f32> {
    costs.sort_by(f32::total_cmp);
    let (mut sum, mut total, mut weight) = (0.0f32, 0.0f32, 1.0f32);
    for cost in costs.iter().take_while(|cost| !cost.is_nan()) {
        sum += weight * cost;
        total += weight;
        weight *= 0.5;
    }
    (total > 0.0).then(|| sum / total)
}

/// Scratch of one band of rows at one candidate.
#[derive(Default)]
struct Band {
    reference: Vec<f32>,
    warped: Vec<f32>,
    seen: Vec<bool>,
    small: Vec<f32>,
    wide: Vec<f32>,
    zncc: ZnccBand,
    /// `[pixel][source]` costs in \[0, 1\], NaN where the source does not see the point.
    total: Vec<f32>,
}

impl Band {
    fn score(
        &mut self,
        reference: &MatchImage,
        source: &MatchImage,
        warp: &Warp,
        w: f64,
        rows: std::ops::Range<usize>,
        weights: &CostWeights,
        features: Option<(&FeatureCosts, usize)>,
        source_index: usize,
        num_sources: usize,
    ) {
        let (width, height) = (reference.gray.width(), reference.gray.height());
        let halo = weights.wide_radius;
        let padded = rows.len() + 2 * halo;
        self.reference.resize(padded * width, 0.0);
        self.warped.resize(padded * width, 0.0);
        self.seen.resize(padded * width, false);
        for row in 0..padded {
            // Rows beyond the image repeat its border.
            let y = (rows.start + row).saturating_sub(halo).min(height - 1);
            let span = row * width..(row + 1) * width;
            self.reference[span.clone()].copy_from_slice(reference.gray.row(y));
            warp_row(source, warp, y, w, &mut self.warped[span.clone()], &mut self.seen[span]);
        }
        let pixels = rows.len() * width;
        self.small.resize(pixels, 0.0);
        self.wide.resize(pixels, 0.0);
        let inner = (halo - weights.small_radius) * width;
        let inner_rows = padded - 2 * (halo - weights.small_radius);
        let (a, b) = (&self.reference[inner..], &self.warped[inner..]);
        self.zncc.score(a, b, width, inner_rows, weights.small_radius, &mut self.small);
        self.zncc.score(&self.reference, &self.warped, width, padded, halo, &mut self.wide);
        let feature_weight = if features.is_some() { weights.features } else { 0.0 };
        let inverse = 1.0 / (weights.small + weights.wide + feature_weight);
        for row in 0..rows.len() {
            let y = rows.start + row;
            for x in 0..width {
                let pixel = row * width + x;
                if !self.seen[(row + halo) * width + x] {
                    continue;
                }
                let mut cost = weights.small * (1.0 - self.small[pixel]) + weights.wide * (1.0 - self.wide[pixel]);
                if let Some((features, j)) = features {
                    cost += feature_weight * features.at(x, y, j);
                }
                self.total[pixel * num_sources + source_index] = (0.5 * cost * inverse).clamp(0.0, 1.0);
            }
        }
    }
}

/// Luma of `source` where row `y` of the reference lands at inverse depth `w`; the nearest border value outside.
fn warp_row(source: &MatchImage, warp: &Warp, y: usize, w: f64, out: &mut [f32], seen: &mut [bool]) {
    let (width, height) = (source.gray.width(), source.gray.height());
    let start = warp.at_infinity(0.0, y as f64) + warp.parallax() * w;
    let step = warp.at_infinity(1.0, y as f64) - warp.at_infinity(0.0, y as f64);
    let (max_x, max_y) = ((width - 1) as f32, (height - 1) as f32);
    let pixels = source.gray.as_slice();
    let valid = source.valid.as_slice();
    for (x, (out, seen)) in out.iter_mut().zip(seen).enumerate() {
        let t = x as f64;
        let z = start.z + step.z * t;
        let inverse = if z > 1e-9 { 1.0 / z } else { 0.0 };
        let sx = ((start.x + step.x * t) * inverse) as f32;
        let sy = ((start.y + step.y * t) * inverse) as f32;
        *seen = z > 1e-9 && sx >= -0.5 && sy >= -0.5 && sx <= max_x + 0.5 && sy <= max_y + 0.5;
        let (cx, cy) = (sx.clamp(0.0, max_x), sy.clamp(0.0, max_y));
        let (x0, y0) = (cx as usize, cy as usize);
        let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
        let (fx, fy) = (cx - x0 as f32, cy - y0 as f32);
        let top = pixels[y0 * width + x0] * (1.0 - fx) + pixels[y0 * width + x1] * fx;
        let bottom = pixels[y1 * width + x0] * (1.0 - fx) + pixels[y1 * width + x1] * fx;
        *out = top * (1.0 - fy) + bottom * fy;
        *seen &= valid[(cy + 0.5) as usize * width + (cx + 0.5) as usize];
    }
}

/// `1 - cosine` of the features at every feature pixel and candidate.
struct FeatureCosts {
    width: usize,
    height: usize,
    stride: f32,
    origin: f32,
    count: usize,
    costs: Vec<f32>,
}

impl FeatureCosts {
    fn sweep(reference: &MatchImage, source: &MatchImage, warp: &Warp, candidates: &Candidates) -> Option<Self> {
        let (a, b) = (reference.features?, source.features?);
        let count = candidates.count;
        let mut costs = vec![1.0f32; a.width * a.height * count];
        costs.par_chunks_mut(a.width * count).enumerate().for_each(|(fy, row)| {
            let mut sample = vec![0.0f32; b.channels];
            for (fx, out) in row.chunks_exact_mut(count).enumerate() {
                let (x, y) = (a.origin + a.stride * fx as f64, a.origin + a.stride * fy as f64);
                let own = &a.data[(fy * a.width + fx) * a.channels..][..a.channels];
                for (j, cost) in out.iter_mut().enumerate() {
                    let landing = warp.land(x, y, candidates.inverse_depth(j as f64));
                    let (bx, by) = ((landing.x - b.origin) / b.stride, (landing.y - b.origin) / b.stride);
                    if landing.relative_depth > 1e-9 && sample_features(&b, bx as f32, by as f32, &mut sample) {
                        *cost = 1.0 - cosine(own, &sample);
                    }
                }
            }
        });
        Some(Self { width: a.width, height: a.height, stride: a.stride as f32, origin: a.origin as f32, count, costs })
    }

    /// Bilinear upsampling to reference pixel `(x, y)`.
    fn at(&self, x: usize, y: usize, candidate: usize) -> f32 {
        let fx = ((x as f32 - self.origin) / self.stride).clamp(0.0, (self.width - 1) as f32);
        let fy = ((y as f32 - self.origin) / self.stride).clamp(0.0, (self.height - 1) as f32);
        let (x0, y0) = (fx as usize, fy as usize);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let (tx, ty) = (fx - x0 as f32, fy - y0 as f32);
        let value = |x: usize, y: usize| self.costs[(y * self.width + x) * self.count + candidate];
        let top = value(x0, y0) * (1.0 - tx) + value(x1, y0) * tx;
        let bottom = value(x0, y1) * (1.0 - tx) + value(x1, y1) * tx;
        top * (1.0 - ty) + bottom * ty
    }
}

fn sample_features(grid: &FeatureGrid, x: f32, y: f32, out: &mut [f32]) -> bool {
    if !(x >= -0.5 && y >= -0.5 && x <= grid.width as f32 - 0.5 && y <= grid.height as f32 - 0.5) {
        return false;
    }
    let (x, y) = (x.clamp(0.0, (grid.width - 1) as f32), y.clamp(0.0, (grid.height - 1) as f32));
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(grid.width - 1), (y0 + 1).min(grid.height - 1));
    let (fx, fy) = (x - x0 as f32, y - y0 as f32);
    let at = |x: usize, y: usize| &grid.data[(y * grid.width + x) * grid.channels..][..grid.channels];
    let (p00, p10, p01, p11) = (at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1));
    for (c, out) in out.iter_mut().enumerate() {
        let top = p00[c] * (1.0 - fx) + p10[c] * fx;
        let bottom = p01[c] * (1.0 - fx) + p11[c] * fx;
        *out = top * (1.0 - fy) + bottom * fy;
    }
    true
}

fn cosine(a: &[f32], b: &[f32]) -> f32 {
    let (mut ab, mut aa, mut bb) = (0.0f32, 0.0f32, 0.0f32);
    for (a, b) in a.iter().zip(b) {
        ab += a * b;
        aa += a * a;
        bb += b * b;
    }
    ab / (aa * bb).sqrt().max(1e-12)
}
