//! The matching cost of learned features, on their own coarser grid.
//!
//! The other half of the sweep's cost, brought to the pixels of the photograph by bilinear interpolation.
//! Invariant: a feature pixel that lands outside the other view's features costs 1, as no likeness does.

use crate::candidates::Candidates;
use crate::packed::{MIN_AHEAD, RowWarp};
use crate::warp::Warp;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

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

impl FeatureGrid<'_> {
    fn at(&self, x: usize, y: usize) -> &[f32] {
        &self.data[(y * self.width + x) * self.channels..][..self.channels]
    }
}

/// `1 - cosine` of the features at every feature pixel and candidate.
pub struct FeatureCosts {
    width: usize,
    count: usize,
    /// `[height][candidates][width]`.
    costs: Vec<f32>,
    /// Per reference column, its feature columns.
    columns: Vec<Tap>,
    /// Per reference row, its feature rows.
    rows: Vec<Tap>,
}

/// Linear interpolation between two neighbours.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tap {
    /// The one before.
    pub first: usize,
    /// The one after.
    pub second: usize,
    /// Weight of the one after.
    pub t: f32,
}

/// For each of `pixels` pixels, where it lies among `count` feature pixels.
fn taps(pixels: usize, stride: f64, origin: f64, count: usize) -> Vec<Tap> {
    (0..pixels)
        .map(|i| {
            let at = ((i as f64 - origin) / stride).clamp(0.0, (count - 1) as f64);
            let first = at as usize;
            Tap { first, second: (first + 1).min(count - 1), t: (at - first as f64) as f32 }
        })
        .collect()
}

impl FeatureCosts {
    /// Sweeps the candidates; `size` is that of the reference photograph.
    pub fn sweep(a: &FeatureGrid, b: &FeatureGrid, warp: &Warp, candidates: &Candidates, size: (usize, usize)) -> Self {
        let count = candidates.count;
        let mut costs = vec![0.0f32; a.width * a.height * count];
        let w: Vec<f32> = (0..count).map(|j| candidates.inverse_depth(j as f64) as f32).collect();
        let arch = Arch::new();
        costs.par_chunks_mut(a.width * count).enumerate().for_each_init(Scratch::default, |scratch, (y, out)| {
            let landing = RowWarp::along(warp, (a.origin, a.origin + a.stride * y as f64), a.stride);
            arch.dispatch(CostRow { a, b, y, landing, w: &w, scratch, out });
        });
        Self {
            width: a.width,
            count,
            costs,
            columns: taps(size.0, a.stride, a.origin, a.width),
            rows: taps(size.1, a.stride, a.origin, a.height),
        }
    }

    /// Where a row of the reference lies among the feature rows.
    pub fn row_tap(&self, y: usize) -> Tap {
        self.rows[y]
    }

    /// The costs of feature row `y` at a candidate, at the columns of the reference.
    #[inline(always)]
    pub fn widened(&self, y: usize, candidate: usize, out: &mut [f32]) {
        let row = &self.costs[(y * self.count + candidate) * self.width..][..self.width];
        for (out, tap) in out.iter_mut().zip(&self.columns) {
            *out = row[tap.first] + (row[tap.second] - row[tap.first]) * tap.t;
        }
    }
}

/// Room for the places of one feature row at one candidate; NaN where it lands outside.
#[derive(Default)]
struct Scratch {
    x: Vec<f32>,
    y: Vec<f32>,
}

/// One feature row at all candidates.
struct CostRow<'a> {
    a: &'a FeatureGrid<'a>,
    b: &'a FeatureGrid<'a>,
    y: usize,
    landing: RowWarp,
    w: &'a [f32],
    scratch: &'a mut Scratch,
    /// `[candidates][width]`.
    out: &'a mut [f32],
}

impl WithSimd for CostRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { a, b, y, landing, w, scratch, out } = self;
        scratch.x.resize(a.width, 0.0);
        scratch.y.resize(a.width, 0.0);
        for (&w, out) in w.iter().zip(out.chunks_exact_mut(a.width)) {
            places(b, &landing, w, &mut scratch.x, &mut scratch.y);
            for (x, out) in out.iter_mut().enumerate() {
                let (bx, by) = (scratch.x[x], scratch.y[x]);
                *out = if bx.is_nan() {
                    1.0
                } else {
                    let (x0, y0) = (bx as usize, by as usize);
                    let (x1, y1) = ((x0 + 1).min(b.width - 1), (y0 + 1).min(b.height - 1));
                    let (tx, ty) = (bx - x0 as f32, by - y0 as f32);
                    let corners = [b.at(x0, y0), b.at(x1, y0), b.at(x0, y1), b.at(x1, y1)];
                    let weights = [(1.0 - tx) * (1.0 - ty), tx * (1.0 - ty), (1.0 - tx) * ty, tx * ty];
                    1.0 - cosine(simd, a.at(x, y), corners, weights)
                };
            }
        }
    }
}

/// Where a row of feature pixels lands among the features of the other view at inverse depth `w`.
#[inline(always)]
fn places(b: &FeatureGrid, landing: &RowWarp, w: f32, out_x: &mut [f32], out_y: &mut [f32]) {
    let (max_x, max_y) = ((b.width - 1) as f32, (b.height - 1) as f32);
    let (origin, inverse_stride) = (b.origin as f32, 1.0 / b.stride as f32);
    for (i, (out_x, out_y)) in out_x.iter_mut().zip(out_y).enumerate() {
        let [x, y, z] = landing.at(i as i32 as f32, w);
        let inverse = 1.0 / z;
        let (x, y) = ((x * inverse - origin) * inverse_stride, (y * inverse - origin) * inverse_stride);
        let inside = (z > MIN_AHEAD) & (x >= -0.5) & (y >= -0.5) & (x <= max_x + 0.5) & (y <= max_y + 0.5);
        *out_x = if inside { x.max(0.0).min(max_x) } else { f32::NAN };
        *out_y = y.max(0.0).min(max_y);
    }
}

/// Cosine of `a` and the weighted sum of `corners`.
#[inline(always)]
fn cosine<S: Simd>(simd: S, a: &[f32], corners: [&[f32]; 4], weights: [f32; 4]) -> f32 {
    let (a, a_tail) = S::as_simd_f32s(a);
    let corners = corners.map(|corner| S::as_simd_f32s(corner));
    let factors = weights.map(|weight| simd.splat_f32s(weight));
    let [mut ab, mut aa, mut bb] = [simd.splat_f32s(0.0); 3];
    for (i, &a) in a.iter().enumerate() {
        let mut b = simd.mul_f32s(corners[0].0[i], factors[0]);
        for (corner, &factor) in corners[1..].iter().zip(&factors[1..]) {
            b = simd.mul_add_e_f32s(corner.0[i], factor, b);
        }
        ab = simd.mul_add_e_f32s(a, b, ab);
        aa = simd.mul_add_e_f32s(a, a, aa);
        bb = simd.mul_add_e_f32s(b, b, bb);
    }
    let mut sums = [ab, aa, bb].map(|sum| simd.reduce_sum_f32s(sum));
    for (i, &a) in a_tail.iter().enumerate() {
        let b: f32 = corners.iter().zip(weights).map(|(corner, weight)| corner.1[i] * weight).sum();
        sums = [sums[0] + a * b, sums[1] + a * a, sums[2] + b * b];
    }
    sums[0] / (sums[1] * sums[2]).sqrt().max(1e-12)
}
