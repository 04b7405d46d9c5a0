//! Plane propagation: each pixel joins one of the surfaces that its surroundings propose for it.
//!
//! A proposal is a neighbour's plane in inverse depth, continued to the pixel. The weights are a softmax over
//! the proposals of scores that blocks of `stride` x `stride` pixels share, and of each pixel's own lean towards the
//! nearer or the farther of them: an edge may run through a block. Proposals within [`REACH`] of each other are one
//! surface; the pixel takes the weighted mean of the surface with the most weight. A mean over all would put an
//! undecided pixel between two surfaces, where nothing is. Invariant: equal planes everywhere come back unchanged,
//! whatever the weights, and what comes back lies within [`REACH`] of a proposal.

use rayon::prelude::*;

/// Proposals farther than this from the pixel's own plane are drawn in, steps.
const FARTHEST: f32 = 64.0;

/// Proposals this far from the one in their middle are of its surface, steps.
pub const REACH: f32 = 4.0;

/// Steps at which a difference of inverse depth counts half of what it could.
const SOFT_STEPS: f32 = 2.0;

/// Odd, in (-1, 1), steepest at zero: small differences keep their size, large ones only their sign.
pub(crate) fn soft(steps: f32) -> f32 {
    steps / (SOFT_STEPS + steps.abs())
}

/// Index `by` away from `at`, or at the border of `len`.
pub(crate) fn clamped(at: usize, by: i32, len: usize) -> usize {
    (at as i64 + i64::from(by)).clamp(0, len as i64 - 1) as usize
}

/// The planes of all views and where proposals come from.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposals {
    /// Columns of an image.
    pub width: usize,
    /// Rows of an image.
    pub height: usize,
    /// Pixels that share weights, along each axis; divides both sides.
    pub stride: usize,
    /// Inverse depth in steps, and its change per pixel to the right and down; `[views, height, width]`.
    pub planes: Vec<[f32; 3]>,
    /// Offsets of the proposing pixels, columns and rows.
    pub offsets: Vec<[i32; 2]>,
}

impl Proposals {
    /// Number of views.
    pub fn num_views(&self) -> usize {
        self.planes.len() / (self.width * self.height).max(1)
    }

    /// Columns and rows of the weights.
    pub fn weight_size(&self) -> (usize, usize) {
        (self.width / self.stride, self.height / self.stride)
    }

    /// What proposal `k` says of pixel `(x, y)`: inverse depth relative to the pixel's own, and its slopes.
    pub fn at(&self, view: usize, x: usize, y: usize, k: usize) -> [f32; 3] {
        let start = view * self.width * self.height;
        let (nx, ny) = (clamped(x, self.offsets[k][0], self.width), clamped(y, self.offsets[k][1], self.height));
        let own = self.planes[start + y * self.width + x];
        let [w, w_x, w_y] = self.planes[start + ny * self.width + nx];
        let (dx, dy) = (x as f32 - nx as f32, y as f32 - ny as f32);
        [(w + w_x * dx + w_y * dy - own[0]).clamp(-FARTHEST, FARTHEST), w_x, w_y]
    }
}

/// Planes `[views, 3, height, width]` (inverse depth relative to the pixel's own, slopes) of scores
/// `[views, proposals, height / stride, width / stride]` and leans `[views, height, width]`, above zero to the nearer:
/// a lean of one adds a proposal's difference, softly in (-1, 1), to its score.
pub fn forward(scores: &[f32], leans: &[f32], proposals: &Proposals) -> Vec<f32> {
    let (width, pixels) = (proposals.width, proposals.width * proposals.height);
    let mut planes = vec![0.0; 3 * pixels * proposals.num_views()];
    for (view, planes) in planes.chunks_exact_mut(3 * pixels).enumerate() {
        let (w, slopes) = planes.split_at_mut(pixels);
        let (w_x, w_y) = slopes.split_at_mut(pixels);
        let rows = w.par_chunks_mut(width).zip(w_x.par_chunks_mut(width)).zip(w_y.par_chunks_mut(width));
        rows.enumerate().for_each(|(y, ((w, w_x), w_y))| {
            let mut pixel = Pixel::new(proposals.offsets.len());
            for x in 0..width {
                pixel.choose(scores, leans, proposals, view, x, y);
                let mut sum = [0.0f32; 3];
                for (share, plane) in pixel.shares.iter().zip(&pixel.planes) {
                    sum.iter_mut().zip(plane).for_each(|(sum, value)| *sum += share * value);
                }
                [w[x], w_x[x], w_y[x]] = sum;
            }
        });
    }
    planes
}

/// Gradients of the scores and of the leans from that of the planes; same layouts as [`forward`].
pub fn backward(scores: &[f32], leans: &[f32], proposals: &Proposals, grad: &[f32]) -> (Vec<f32>, Vec<f32>) {
    let (width, stride) = (proposals.width, proposals.stride);
    let (pixels, count) = (width * proposals.height, proposals.offsets.len());
    let (columns, rows) = proposals.weight_size();
    let mut leans_grad = vec![0.0f32; leans.len()];
    // Rows first, so that each task owns what it writes; turned to the layout of the scores afterwards.
    let mut by_row = vec![0.0f32; proposals.num_views() * rows * count * columns];
    let tasks = by_row.par_chunks_mut(count * columns).zip(leans_grad.par_chunks_mut(stride * width));
    tasks.enumerate().for_each(|(row, (of_scores, of_leans))| {
        let (view, first_y) = (row / rows, row % rows * stride);
        let grad = &grad[view * 3 * pixels..][..3 * pixels];
        let mut pixel = Pixel::new(count);
        for (i, of_lean) in of_leans.iter_mut().enumerate() {
            let (x, y) = (i % width, first_y + i / width);
            pixel.choose(scores, leans, proposals, view, x, y);
            let at = y * width + x;
            let g = [grad[at], grad[pixels + at], grad[2 * pixels + at]];
            let gain = |plane: &[f32; 3]| g[0] * plane[0] + g[1] * plane[1] + g[2] * plane[2];
            let mean: f32 = pixel.shares.iter().zip(&pixel.planes).map(|(share, plane)| share * gain(plane)).sum();
            for (k, (share, plane)) in pixel.shares.iter().zip(&pixel.planes).enumerate() {
                let of_weight = share * (gain(plane) - mean);
                of_scores[k * columns + x / stride] += of_weight;
                *of_lean += of_weight * soft(plane[0]);
            }
        }
    });
    let mut scores_grad = vec![0.0f32; by_row.len()];
    for (row, values) in by_row.chunks_exact(count * columns).enumerate() {
        let (view, block_y) = (row / rows, row % rows);
        for (k, values) in values.chunks_exact(columns).enumerate() {
            scores_grad[((view * count + k) * rows + block_y) * columns..][..columns].copy_from_slice(values);
        }
    }
    (scores_grad, leans_grad)
}

/// What is proposed to one pixel, and how it chooses.
struct Pixel {
    planes: Vec<[f32; 3]>,
    /// Inverse depths of the planes, their weights, and the weight of the surface around each.
    depths: Vec<f32>,
    weights: Vec<f32>,
    masses: Vec<f32>,
    /// Weights within the surface chosen, which sum to one; 0 outside.
    shares: Vec<f32>,
}

impl Pixel {
    fn new(count: usize) -> Self {
        let zeros = || vec![0.0; count];
        Self { planes: vec![[0.0; 3]; count], depths: zeros(), weights: zeros(), masses: zeros(), shares: zeros() }
    }

    /// The surface with the most weight; of equal ones, that around the first.
    fn choose(&mut self, scores: &[f32], leans: &[f32], proposals: &Proposals, view: usize, x: usize, y: usize) {
        let ((columns, rows), count) = (proposals.weight_size(), self.planes.len());
        let lean = leans[(view * proposals.height + y) * proposals.width + x];
        let block = y / proposals.stride * columns + x / proposals.stride;
        for k in 0..count {
            self.planes[k] = proposals.at(view, x, y, k);
            self.depths[k] = self.planes[k][0];
            self.weights[k] = scores[(view * count + k) * rows * columns + block] + lean * soft(self.depths[k]);
        }
        let largest = self.weights.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        self.weights.iter_mut().for_each(|weight| *weight = (*weight - largest).exp());
        self.masses.fill(0.0);
        for (weight, from) in self.weights.iter().zip(&self.depths) {
            for (mass, to) in self.masses.iter_mut().zip(&self.depths) {
                *mass += if (from - to).abs() <= REACH { *weight } else { 0.0 };
            }
        }
        let better = |best: usize, k: usize| if self.masses[k] > self.masses[best] { k } else { best };
        let middle = (1..count).fold(0, better);
        for k in 0..count {
            let is_near = (self.depths[k] - self.depths[middle]).abs() <= REACH;
            self.shares[k] = if is_near { self.weights[k] / self.masses[middle] } else { 0.0 };
        }
    }
}
