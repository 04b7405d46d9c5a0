//! Plane propagation: each pixel joins one of the surfaces that its surroundings propose for it.
//!
//! A proposal is a neighbour's plane in inverse depth, continued to the pixel. The weights are a softmax over
//! the proposals, shared by blocks of `stride` x `stride` pixels. Proposals within [`REACH`] of each other are one
//! surface; the pixel takes the weighted mean of the surface with the most weight. A mean over all would put an
//! undecided pixel between two surfaces, where nothing is. Invariant: equal planes everywhere come back unchanged,
//! whatever the weights, and what comes back lies within [`REACH`] of a proposal.

use rayon::prelude::*;

/// Proposals farther than this from the pixel's own plane are drawn in, steps.
const FARTHEST: f32 = 64.0;

/// Proposals this far from the one in their middle are of its surface, steps.
pub const REACH: f32 = 4.0;

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
        let clamped = |at: usize, by: i32, len: usize| (at as i64 + i64::from(by)).clamp(0, len as i64 - 1) as usize;
        let (nx, ny) = (clamped(x, self.offsets[k][0], self.width), clamped(y, self.offsets[k][1], self.height));
        let own = self.planes[start + y * self.width + x];
        let [w, w_x, w_y] = self.planes[start + ny * self.width + nx];
        let (dx, dy) = (x as f32 - nx as f32, y as f32 - ny as f32);
        [(w + w_x * dx + w_y * dy - own[0]).clamp(-FARTHEST, FARTHEST), w_x, w_y]
    }
}

/// Planes `[views, 3, height, width]` (inverse depth relative to the pixel's own, slopes) of scores
/// `[views, proposals, height / stride, width / stride]`.
pub fn forward(scores: &[f32], proposals: &Proposals) -> Vec<f32> {
    let (width, pixels) = (proposals.width, proposals.width * proposals.height);
    let mut planes = vec![0.0; 3 * pixels * proposals.num_views()];
    for (view, planes) in planes.chunks_exact_mut(3 * pixels).enumerate() {
        let (w, slopes) = planes.split_at_mut(pixels);
        let (w_x, w_y) = slopes.split_at_mut(pixels);
        let rows = w.par_chunks_mut(width).zip(w_x.par_chunks_mut(width)).zip(w_y.par_chunks_mut(width));
        rows.enumerate().for_each(|(y, ((w, w_x), w_y))| {
            let mut pixel = Pixel::new(proposals.offsets.len());
            for x in 0..width {
                if x % proposals.stride == 0 {
                    pixel.weigh(scores, proposals, view, x / proposals.stride, y / proposals.stride);
                }
                pixel.choose(proposals, view, x, y);
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

/// Gradient of the scores from that of the planes; same layouts as [`forward`].
pub fn backward(scores: &[f32], proposals: &Proposals, grad: &[f32]) -> Vec<f32> {
    let (pixels, count) = (proposals.width * proposals.height, proposals.offsets.len());
    let (columns, rows) = proposals.weight_size();
    // Rows first, so that each task owns what it writes; turned to the layout of the scores afterwards.
    let mut by_row = vec![0.0f32; proposals.num_views() * rows * count * columns];
    by_row.par_chunks_mut(count * columns).enumerate().for_each(|(row, out)| {
        let (view, block_y) = (row / rows, row % rows);
        let grad = &grad[view * 3 * pixels..][..3 * pixels];
        let mut pixel = Pixel::new(count);
        let mut gains = vec![0.0f32; count];
        for block_x in 0..columns {
            pixel.weigh(scores, proposals, view, block_x, block_y);
            for y in block_y * proposals.stride..(block_y + 1) * proposals.stride {
                for x in block_x * proposals.stride..(block_x + 1) * proposals.stride {
                    pixel.choose(proposals, view, x, y);
                    let at = y * proposals.width + x;
                    let g = [grad[at], grad[pixels + at], grad[2 * pixels + at]];
                    let gain = |plane: &[f32; 3]| g[0] * plane[0] + g[1] * plane[1] + g[2] * plane[2];
                    gains.iter_mut().zip(&pixel.planes).for_each(|(into, plane)| *into = gain(plane));
                    let mean: f32 = pixel.shares.iter().zip(&gains).map(|(share, gain)| share * gain).sum();
                    for k in 0..count {
                        out[k * columns + block_x] += pixel.shares[k] * (gains[k] - mean);
                    }
                }
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
    scores_grad
}

/// What is proposed to one pixel, and how it chooses.
struct Pixel {
    /// Softmax of the scores of its block.
    weights: Vec<f32>,
    planes: Vec<[f32; 3]>,
    /// Inverse depths of the planes, and the weight of the surface around each.
    depths: Vec<f32>,
    masses: Vec<f32>,
    /// Weights within the surface chosen, which sum to one; 0 outside.
    shares: Vec<f32>,
}

impl Pixel {
    fn new(count: usize) -> Self {
        let zeros = || vec![0.0; count];
        Self { weights: zeros(), planes: vec![[0.0; 3]; count], depths: zeros(), masses: zeros(), shares: zeros() }
    }

    /// The weights of a block.
    fn weigh(&mut self, scores: &[f32], proposals: &Proposals, view: usize, x: usize, y: usize) {
        let (columns, rows) = proposals.weight_size();
        let count = self.weights.len();
        let at = |k: usize| scores[((view * count + k) * rows + y) * columns + x];
        let largest = (0..count).map(at).fold(f32::NEG_INFINITY, f32::max);
        self.weights.iter_mut().enumerate().for_each(|(k, weight)| *weight = (at(k) - largest).exp());
        normalise(&mut self.weights);
    }

    /// The surface with the most weight; of equal ones, that around the first.
    fn choose(&mut self, proposals: &Proposals, view: usize, x: usize, y: usize) {
        for (k, (plane, depth)) in self.planes.iter_mut().zip(&mut self.depths).enumerate() {
            *plane = proposals.at(view, x, y, k);
            *depth = plane[0];
        }
        self.masses.fill(0.0);
        for (weight, from) in self.weights.iter().zip(&self.depths) {
            for (mass, to) in self.masses.iter_mut().zip(&self.depths) {
                *mass += if (from - to).abs() <= REACH { *weight } else { 0.0 };
            }
        }
        let better = |best: usize, k: usize| if self.masses[k] > self.masses[best] { k } else { best };
        let middle = self.depths[(1..self.masses.len()).fold(0, better)];
        for ((share, weight), depth) in self.shares.iter_mut().zip(&self.weights).zip(&self.depths) {
            *share = if (depth - middle).abs() <= REACH { *weight } else { 0.0 };
        }
        normalise(&mut self.shares);
    }
}

fn normalise(weights: &mut [f32]) {
    let total: f32 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= total);
}
