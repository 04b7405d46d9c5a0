//! The weighted sums behind a plane fit, a vector of pixels at a time.
//!
//! [`crate::plane_fit`] prepares the rows and solves. Every pixel reads the same offsets, so neighbouring
//! pixels are neighbouring lanes and every read is contiguous. Invariant: a pixel of weight zero, which all
//! pixels outside the image are, contributes nothing.

use crate::padded::{Layout, Padded};
use crate::plane_fit::{Evidence, Plane};
use crate::vector::{load, store};
use pulp::{Simd, WithSimd};
use surfel_core::Grid;

/// Evidence and guide, one plane per number.
pub struct Layers {
    pub layout: Layout,
    weight: Padded,
    w: Padded,
    colour: [Padded; 3],
    /// Mean evidence around every pixel.
    pub strength: Grid<f32>,
}

impl Layers {
    pub fn new(evidence: &Grid<Evidence>, guide: &Grid<[f32; 3]>, margin: usize) -> Self {
        let layout = Layout { width: evidence.width(), height: evidence.height(), margin };
        let weight = Padded::new(layout, 0.0, |x, y| evidence[(x, y)].weight.max(0.0));
        Self {
            layout,
            strength: strength(&layout, &weight),
            weight,
            w: Padded::new(layout, 0.0, |x, y| evidence[(x, y)].w),
            colour: std::array::from_fn(|c| Padded::new(layout, 0.0, |x, y| guide[(x, y)][c])),
        }
    }

    /// The same evidence for another surface.
    pub fn say(&mut self, surface: &Grid<Plane>) {
        self.w = Padded::new(self.layout, 0.0, |x, y| surface[(x, y)].w);
    }
}

/// Means over the pixels nearby.
fn strength(layout: &Layout, weight: &Padded) -> Grid<f32> {
    const SIDE: usize = 2 * STRENGTH_RADIUS + 1;
    let mut means = Grid::filled(layout.width, layout.height, 0.0);
    let mut columns = vec![0.0f32; layout.width + 2 * STRENGTH_RADIUS];
    for (y, row) in means.as_mut_slice().chunks_exact_mut(layout.width).enumerate() {
        let first = layout.index(0, y) - STRENGTH_RADIUS * (layout.stride() + 1);
        columns.fill(0.0);
        for dy in 0..SIDE {
            let weights = &weight.data[first + dy * layout.stride()..];
            columns.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight);
        }
        for (mean, window) in row.iter_mut().zip(columns.array_windows::<SIDE>()) {
            *mean = window.iter().sum::<f32>() / (SIDE * SIDE) as f32;
        }
    }
    means
}

/// The offsets of a neighbourhood that share a row.
pub struct Run {
    dy: f32,
    taps: Vec<Tap>,
}

struct Tap {
    /// In the layers, from the pixel to its neighbour.
    offset: isize,
    dx: f32,
    distance_sq: f32,
}

/// Offsets `(dx, dy)`, sorted by `dy`, as the kernel reads them.
pub fn runs(offsets: &[(isize, isize)], layout: &Layout) -> Vec<Run> {
    offsets
        .chunk_by(|a, b| a.1 == b.1)
        .map(|run| Run {
            dy: run[0].1 as f32,
            taps: run
                .iter()
                .map(|&(dx, dy)| Tap {
                    offset: layout.offset(dx, dy),
                    dx: dx as f32,
                    distance_sq: (dx * dx + dy * dy) as f32,
                })
                .collect(),
        })
        .collect()
}

/// One row of pixels, padded to whole vectors.
#[derive(Default)]
pub struct Row {
    w: Vec<f32>,
    w_x: Vec<f32>,
    w_y: Vec<f32>,
    inverse_reach_sq: Vec<f32>,
    /// `Σ weight · (1, dx, dy, dx², dx dy, dy², r, r dx, r dy)` with `r` the residual of the neighbour.
    sums: [Vec<f32>; 9],
}

impl Row {
    /// Takes the current planes of a row.
    fn begin(&mut self, planes: &[Plane], padded: usize) {
        let Self { w, w_x, w_y, inverse_reach_sq, sums } = self;
        for part in [&mut *w, w_x, w_y, inverse_reach_sq].into_iter().chain(sums) {
            part.resize(padded, 0.0);
        }
        for (plane, ((w, w_x), w_y)) in planes.iter().zip(w.iter_mut().zip(w_x).zip(w_y)) {
            (*w, *w_x, *w_y) = (plane.w, plane.w_x, plane.w_y);
        }
    }

    /// How far the fit of each pixel reaches: farther where there is less evidence nearby.
    fn measure(&mut self, strength: &[f32], reach: &Reach) {
        for (inverse_reach_sq, strength) in self.inverse_reach_sq.iter_mut().zip(strength) {
            *inverse_reach_sq = reach.inverse_sq(*strength);
        }
    }
}

/// How far a fit reaches.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// Squared distance at which a neighbour's weight has halved where evidence is strong, pixels².
    pub strong_sq: f32,
    /// How many times as much that may be where evidence is weak.
    pub widening: f32,
}

impl Reach {
    /// 1 / squared distance at which a neighbour's weight has halved, where the mean evidence nearby is `strength`.
    #[inline(always)]
    pub fn inverse_sq(&self, strength: f32) -> f32 {
        1.0 / (self.strong_sq * (STRONG / strength.max(1e-6)).max(1.0).min(self.widening))
    }
}

/// Evidence weight of well-textured pixels.
pub const STRONG: f32 = 0.25;

/// Evidence is averaged over this many pixels on either side to tell how strong it is.
pub const STRENGTH_RADIUS: usize = 2;

/// Fits a plane around every pixel of a row.
pub struct FitRow<'a> {
    pub layers: &'a Layers,
    pub runs: &'a [Run],
    pub y: usize,
    pub reach: Reach,
    pub inverse_tolerance_sq: f32,
    pub inverse_edge_sq: f32,
    pub row: &'a mut Row,
    /// What is believed, and after it the fit.
    pub planes: &'a mut [Plane],
}

impl WithSimd for FitRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.row.begin(self.planes, self.layers.layout.padded_width());
        self.row.measure(self.layers.strength.row(self.y), &self.reach);
        self.sum(simd);
        self.solve();
    }
}

impl FitRow<'_> {
    /// Fills the sums.
    #[inline(always)]
    fn sum<S: Simd>(&mut self, simd: S) {
        let Layers { layout, weight: weights, w, colour: [red, green, blue], .. } = self.layers;
        let Row { w: own_w, w_x, w_y, inverse_reach_sq, sums, .. } = &mut *self.row;
        let one = simd.splat_f32s(1.0);
        let zero = simd.splat_f32s(0.0);
        let tolerance = simd.splat_f32s(self.inverse_tolerance_sq);
        let edge = simd.splat_f32s(self.inverse_edge_sq);
        for x in (0..layout.padded_width()).step_by(S::F32_LANES) {
            let centre = layout.index(x, self.y);
            let own_red = load(simd, &red.data, centre);
            let own_green = load(simd, &green.data, centre);
            let own_blue = load(simd, &blue.data, centre);
            let [plane_w, plane_x, plane_y] = [load(simd, own_w, x), load(simd, w_x, x), load(simd, w_y, x)];
            let reach = load(simd, inverse_reach_sq, x);
            let mut total = [zero; 9];
            for run in self.runs {
                let dy = simd.splat_f32s(run.dy);
                let believed = simd.mul_add_e_f32s(plane_y, dy, plane_w);
                // Sums over this row of offsets: `dy` is the same for all and enters once, below.
                let [mut s, mut s_x, mut s_xx, mut r, mut r_x] = [zero; 5];
                for tap in &run.taps {
                    let at = centre.wrapping_add_signed(tap.offset);
                    let dx = simd.splat_f32s(tap.dx);
                    let residual = simd.sub_f32s(load(simd, &w.data, at), simd.mul_add_e_f32s(plane_x, dx, believed));
                    let red = simd.sub_f32s(load(simd, &red.data, at), own_red);
                    let green = simd.sub_f32s(load(simd, &green.data, at), own_green);
                    let blue = simd.sub_f32s(load(simd, &blue.data, at), own_blue);
                    let colour_sq =
                        simd.mul_add_e_f32s(red, red, simd.mul_add_e_f32s(green, green, simd.mul_f32s(blue, blue)));
                    let alike = simd.mul_add_e_f32s(colour_sq, edge, one);
                    let agree = simd.mul_add_e_f32s(simd.mul_f32s(residual, residual), tolerance, one);
                    let near = simd.mul_add_e_f32s(simd.splat_f32s(tap.distance_sq), reach, one);
                    let both = simd.mul_f32s(alike, agree);
                    let divisor = simd.mul_f32s(simd.mul_f32s(both, both), near);
                    let weight = simd.div_f32s(load(simd, &weights.data, at), divisor);
                    let (weight_x, pull) = (simd.mul_f32s(weight, dx), simd.mul_f32s(weight, residual));
                    s = simd.add_f32s(s, weight);
                    s_x = simd.add_f32s(s_x, weight_x);
                    s_xx = simd.mul_add_e_f32s(weight_x, dx, s_xx);
                    r = simd.add_f32s(r, pull);
                    r_x = simd.mul_add_e_f32s(pull, dx, r_x);
                }
                let s_y = simd.mul_f32s(s, dy);
                total[0] = simd.add_f32s(total[0], s);
                total[1] = simd.add_f32s(total[1], s_x);
                total[2] = simd.add_f32s(total[2], s_y);
                total[3] = simd.add_f32s(total[3], s_xx);
                total[4] = simd.mul_add_e_f32s(s_x, dy, total[4]);
                total[5] = simd.mul_add_e_f32s(s_y, dy, total[5]);
                total[6] = simd.add_f32s(total[6], r);
                total[7] = simd.add_f32s(total[7], r_x);
                total[8] = simd.mul_add_e_f32s(r, dy, total[8]);
            }
            for (sum, total) in sums.iter_mut().zip(total) {
                store(simd, sum, x, total);
            }
        }
    }

    /// Solves the normal equations and corrects the planes.
    #[inline(always)]
    fn solve(&mut self) {
        let Row { w, w_x, w_y, sums, .. } = &mut *self.row;
        let [s0, s1, s2, s3, s4, s5, s6, s7, s8] = &*sums;
        let n = self.planes.len();
        let corrected = w[..n].iter_mut().zip(&mut w_x[..n]).zip(&mut w_y[..n]);
        let matrix = s0.iter().zip(s1).zip(s2).zip(s3).zip(s4).zip(s5);
        let right = s6.iter().zip(s7).zip(s8);
        for (((w, w_x), w_y), ((((((m0, m1), m2), m3), m4), m5), ((v0, v1), v2))) in corrected.zip(matrix.zip(right)) {
            let [dw, dw_x, dw_y] = solve_symmetric([*m0, *m1, *m2, *m3, *m4, *m5], [*v0, *v1, *v2]);
            (*w, *w_x, *w_y) = (*w + dw, *w_x + dw_x, *w_y + dw_y);
        }
        for (plane, ((w, w_x), w_y)) in self.planes.iter_mut().zip(w.iter().zip(w_x.iter()).zip(w_y.iter())) {
            *plane = Plane { w: *w, w_x: *w_x, w_y: *w_y };
        }
    }
}

/// Solves the symmetric 3x3 system `[[m0 m1 m2] [m1 m3 m4] [m2 m4 m5]] s = v`; falls back to the mean
/// offset when the neighbours do not span a plane. Without a branch, so that a row of systems is solved in vectors.
#[inline(always)]
pub fn solve_symmetric(m: [f32; 6], v: [f32; 3]) -> [f32; 3] {
    /// Total weight below which there is no evidence at all.
    const NOTHING: f32 = 1e-12;
    // A slope needs neighbours at least a fraction of a pixel to the side on both axes.
    const RIDGE: f64 = 1e-3;
    let scale = if m[0] > NOTHING { 1.0 / f64::from(m[0]) } else { 0.0 };
    let (b, c, e) = (f64::from(m[1]) * scale, f64::from(m[2]) * scale, f64::from(m[4]) * scale);
    let (d, f) = (f64::from(m[3]) * scale + RIDGE, f64::from(m[5]) * scale + RIDGE);
    let (x, y, z) = (f64::from(v[0]) * scale, f64::from(v[1]) * scale, f64::from(v[2]) * scale);
    let (c00, c01, c02) = (d * f - e * e, c * e - b * f, b * e - c * d);
    let (c11, c12, c22) = (f - c * c, b * c - e, d - b * b);
    let determinant = c00 + b * c01 + c * c02;
    let spans = determinant > 1e-4;
    let inverse = if spans { 1.0 / determinant } else { 0.0 };
    let offset = if spans { (c00 * x + c01 * y + c02 * z) * inverse } else { x };
    [offset as f32, ((c01 * x + c11 * y + c12 * z) * inverse) as f32, ((c02 * x + c12 * y + c22 * z) * inverse) as f32]
}
