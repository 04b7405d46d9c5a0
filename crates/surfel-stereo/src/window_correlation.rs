//! Correlation of weighted windows of one image with those of several others, a vector of pixels at a time.
//!
//! The inner loop of [`crate::slanted`]. A neighbour weighs the more the nearer it is, the more it looks like the
//! pixel and the nearer it lies to the pixel's plane; these weights are shared by all the other images.
//! Invariant: pixels outside the image weigh nothing.

use crate::config::Refinement;
use crate::packed::MID_GREY;
use crate::padded::{Layout, Padded};
use crate::plane_fit::Plane;
use crate::vector::{load, store};
use crate::zncc::VARIANCE_FLOOR;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use surfel_core::Grid;

/// Images that the reference is compared with: the carried source at this many shifts.
pub const NUM_SHIFTS: usize = 5;

/// The reference, the carried images, and the shape of the window.
pub struct Windows {
    layout: Layout,
    /// Luma relative to mid-grey.
    luma: Padded,
    /// Inverse depth.
    w: Padded,
    /// 1 inside the image, 0 outside.
    inside: Padded,
    /// Luma relative to mid-grey, row by row `[shift][stride]`, margins as in the layout.
    carried: Vec<f32>,
    taps: Vec<Tap>,
    inverse_edge: f32,
}

/// One pixel of the window.
struct Tap {
    /// From a pixel to its neighbour in `luma`.
    offset: isize,
    /// From a pixel to its neighbour in `carried`.
    carried: isize,
    dx: f32,
    dy: f32,
    /// Weight by distance.
    weight: f32,
}

/// Offsets and weights by distance of the pixels of a window: a checkerboard, half the samples with the same support.
pub fn window(radius: usize) -> Vec<(isize, isize, f32)> {
    let radius = radius as isize;
    let offsets = (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dx, dy)));
    let inverse_radius_sq = 1.0 / (radius * radius).max(1) as f32;
    offsets
        .filter(|(dx, dy)| (dx + dy) % 2 == 0)
        .map(|(dx, dy)| (dx, dy, (-inverse_radius_sq * (dx * dx + dy * dy) as f32).exp()))
        .collect()
}

impl Windows {
    /// Windows of the reference, before anything is carried.
    pub fn new(gray: &Grid<f32>, planes: &Grid<Plane>, config: &Refinement) -> Self {
        let layout = Layout { width: gray.width(), height: gray.height(), margin: config.window_radius };
        let tap = |(dx, dy, weight): (isize, isize, f32)| Tap {
            offset: layout.offset(dx, dy),
            carried: layout.offset(dx, dy * NUM_SHIFTS as isize),
            dx: dx as f32,
            dy: dy as f32,
            weight,
        };
        Self {
            layout,
            luma: Padded::new(layout, 0.0, |x, y| gray[(x, y)] - MID_GREY),
            w: Padded::new(layout, 0.0, |x, y| planes[(x, y)].w),
            inside: Padded::new(layout, 0.0, |_, _| 1.0),
            carried: vec![0.0; NUM_SHIFTS * layout.stride() * (layout.height + 2 * layout.margin)],
            taps: window(config.window_radius).into_iter().map(tap).collect(),
            inverse_edge: 1.0 / config.window_edge,
        }
    }

    /// The rows of the carried images, to be filled: per row and shift, as many pixels as the image is wide.
    pub fn carried_rows(&mut self) -> impl IndexedParallelIterator<Item = [&mut [f32]; NUM_SHIFTS]> {
        let Layout { width, height, margin } = self.layout;
        let stride = self.layout.stride();
        let first = NUM_SHIFTS * stride * margin;
        let rows = &mut self.carried[first..][..NUM_SHIFTS * stride * height];
        rows.par_chunks_mut(NUM_SHIFTS * stride).map(move |row| {
            let mut shifts = row.chunks_mut(stride);
            std::array::from_fn(|_| &mut shifts.next().unwrap_or_default()[margin..][..width])
        })
    }
}

/// Scratch and results of one row.
#[derive(Default)]
pub struct CorrelationRow {
    slope_x: Vec<f32>,
    slope_y: Vec<f32>,
    inverse_tolerance: Vec<f32>,
    weights: Vec<f32>,
    weighted: Vec<f32>,
    believed: Vec<f32>,
    correlations: [Vec<f32>; NUM_SHIFTS],
}

impl CorrelationRow {
    /// Correlations of the window of pixel `x` at every shift.
    pub fn correlations(&self, x: usize) -> [f32; NUM_SHIFTS] {
        std::array::from_fn(|k| self.correlations[k][x])
    }

    /// What the window believes of the inverse depth of pixel `x`: a correlation is about all of its pixels.
    pub fn believed(&self, x: usize) -> f32 {
        self.believed[x]
    }

    fn begin(&mut self, planes: &[Plane], step: &[f32], agree: f32, padded: usize) {
        let Self { slope_x, slope_y, inverse_tolerance, believed, correlations, .. } = self;
        for part in [&mut *slope_x, slope_y, inverse_tolerance, believed].into_iter().chain(correlations) {
            part.resize(padded, 0.0);
        }
        let parts = slope_x.iter_mut().zip(slope_y).zip(inverse_tolerance);
        for (((slope_x, slope_y), inverse_tolerance), (plane, &step)) in parts.zip(planes.iter().zip(step)) {
            (*slope_x, *slope_y) = (plane.w_x, plane.w_y);
            *inverse_tolerance = if step > 0.0 { 1.0 / (agree * step) } else { 0.0 };
        }
    }
}

/// Correlates the windows of row `y`.
pub struct CorrelateRow<'a> {
    pub windows: &'a Windows,
    pub y: usize,
    /// The planes of the row.
    pub planes: &'a [Plane],
    /// Inverse depth from shift to shift; 0 where nothing is carried.
    pub step: &'a [f32],
    /// Distance from the plane at which a neighbour's weight has halved, in steps.
    pub agree: f32,
    pub row: &'a mut CorrelationRow,
}

impl WithSimd for CorrelateRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Windows { layout, luma, w, inside, carried, taps, inverse_edge } = self.windows;
        self.row.begin(self.planes, self.step, self.agree, layout.padded_width());
        let CorrelationRow { slope_x, slope_y, inverse_tolerance, weights, weighted, believed, correlations } =
            self.row;
        weights.resize(taps.len() * S::F32_LANES, 0.0);
        weighted.resize(taps.len() * S::F32_LANES, 0.0);
        let (weights, weighted) = (S::as_mut_simd_f32s(weights).0, S::as_mut_simd_f32s(weighted).0);
        let (zero, one, floor) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0), simd.splat_f32s(VARIANCE_FLOOR));
        let edge = simd.splat_f32s(*inverse_edge);
        let stride = layout.stride();
        for x in (0..layout.padded_width()).step_by(S::F32_LANES) {
            let centre = layout.index(x, self.y);
            let (own, own_w) = (load(simd, &luma.data, centre), load(simd, &w.data, centre));
            let (slope_x, slope_y) = (load(simd, slope_x, x), load(simd, slope_y, x));
            let tolerance = load(simd, inverse_tolerance, x);
            let [mut total, mut sum, mut sum_sq, mut sum_apart] = [zero; 4];
            for ((tap, weight), weighted) in taps.iter().zip(weights.iter_mut()).zip(weighted.iter_mut()) {
                let at = centre.wrapping_add_signed(tap.offset);
                let value = load(simd, &luma.data, at);
                let unlike = simd.mul_f32s(simd.sub_f32s(value, own), edge);
                let down = simd.mul_add_e_f32s(slope_y, simd.splat_f32s(tap.dy), own_w);
                let plane = simd.mul_add_e_f32s(slope_x, simd.splat_f32s(tap.dx), down);
                let apart = simd.sub_f32s(load(simd, &w.data, at), plane);
                let off = simd.mul_f32s(apart, tolerance);
                let divisor =
                    simd.mul_f32s(simd.mul_add_e_f32s(unlike, unlike, one), simd.mul_add_e_f32s(off, off, one));
                let near = simd.mul_f32s(simd.splat_f32s(tap.weight), load(simd, &inside.data, at));
                *weight = simd.div_f32s(near, divisor);
                *weighted = simd.mul_f32s(*weight, value);
                total = simd.add_f32s(total, *weight);
                sum = simd.add_f32s(sum, *weighted);
                sum_sq = simd.mul_add_e_f32s(*weighted, value, sum_sq);
                sum_apart = simd.mul_add_e_f32s(*weight, apart, sum_apart);
            }
            // The pixel itself is part of its window, so the total is never zero inside the image.
            let inverse = simd.div_f32s(one, total);
            store(simd, believed, x, simd.mul_add_e_f32s(sum_apart, inverse, own_w));
            let mean_a = simd.mul_f32s(sum, inverse);
            let spread = simd.negate_mul_add_e_f32s(mean_a, mean_a, simd.mul_f32s(sum_sq, inverse));
            let variance_a = simd.add_f32s(simd.max_f32s(spread, zero), floor);
            let first = (self.y + layout.margin) * NUM_SHIFTS * stride + x + layout.margin;
            for (k, out) in correlations.iter_mut().enumerate() {
                let centre = first + k * stride;
                let [mut sum, mut sum_sq, mut product] = [zero; 3];
                for ((tap, &weight), &weighted) in taps.iter().zip(weights.iter()).zip(weighted.iter()) {
                    let value = load(simd, carried, centre.wrapping_add_signed(tap.carried));
                    let own = simd.mul_f32s(weight, value);
                    sum = simd.add_f32s(sum, own);
                    sum_sq = simd.mul_add_e_f32s(own, value, sum_sq);
                    product = simd.mul_add_e_f32s(weighted, value, product);
                }
                let mean = simd.mul_f32s(sum, inverse);
                let spread = simd.negate_mul_add_e_f32s(mean, mean, simd.mul_f32s(sum_sq, inverse));
                let variance = simd.add_f32s(simd.max_f32s(spread, zero), floor);
                let covariance = simd.negate_mul_add_e_f32s(mean_a, mean, simd.mul_f32s(product, inverse));
                let deviations = simd.sqrt_f32s(simd.mul_f32s(variance_a, variance));
                store(simd, out, x, simd.div_f32s(covariance, deviations));
            }
        }
    }
}
