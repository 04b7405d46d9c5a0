//! Plane-sweep correlation (spec 2.4.1, 11.1): for each pixel and depth candidate, the mean over the
//! neighbour views of `F_r . F_o(warped) / sqrt(C)`.
//!
//! Warping and dot product are fused: a warped volume is never stored. Where successive candidates fall
//! into the same cell of four pixels, its four dot products are taken once. Invariant: a sample outside the
//! neighbour's map, or behind its camera, contributes zero.

use super::vector::{add_scaled, dot};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Depth in the neighbour over depth in the reference below which a sample counts as behind the camera.
pub(super) const MIN_DEPTH_RATIO: f32 = 1e-3;
/// Channels whose gradients one task accumulates.
const CHUNK: usize = 32;

/// How the pixels of a reference view map into one neighbour: index pixel `p` at disparity `delta` lands on
/// `rotation (p, 1) + delta translation`, homogeneous, in the neighbour's index coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Warp {
    /// The neighbour view.
    pub other: usize,
    /// `K_o R K_r^-1`, row-major.
    pub rotation: [[f32; 3]; 3],
    /// `K_o t`, pixels times scene units.
    pub translation: [f32; 3],
}

/// A sweep over all views of a scene. Disparity is inverse z-depth, 1 / scene units.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// Columns of the feature maps.
    pub width: usize,
    /// Rows of the feature maps.
    pub height: usize,
    /// For each reference view, its neighbours.
    pub warps: Vec<Vec<Warp>>,
    /// For each reference view, the disparity of each candidate, relative to `base`.
    pub disparities: Vec<Vec<f32>>,
    /// What the candidates are added to.
    pub base: Base,
}

/// Disparity to which the candidates of a sweep are added.
#[derive(Clone, Debug, PartialEq)]
pub enum Base {
    /// Zero everywhere.
    Zero,
    /// One per pixel, `[views, height, width]`.
    PerPixel(Vec<f32>),
    /// One per candidate and pixel, `[views, candidates, height, width]`.
    PerCandidate(Vec<f32>),
}

impl Sweep {
    /// Number of views.
    pub fn num_views(&self) -> usize {
        self.warps.len()
    }

    /// Candidates per pixel.
    pub fn num_candidates(&self) -> usize {
        self.disparities.first().map_or(0, Vec::len)
    }

    fn num_pixels(&self) -> usize {
        self.width * self.height
    }

    /// Disparity of a candidate at the pixel of that index.
    #[inline(always)]
    fn disparity(&self, view: usize, candidate: usize, pixel: usize) -> f32 {
        let base = match &self.base {
            Base::Zero => 0.0,
            Base::PerPixel(base) => base[view * self.num_pixels() + pixel],
            Base::PerCandidate(base) => {
                base[(view * self.disparities[view].len() + candidate) * self.num_pixels() + pixel]
            }
        };
        base + self.disparities[view][candidate]
    }

    /// Disparity of each candidate at each pixel, `[views, candidates, height, width]`.
    #[cfg(any(feature = "cuda", feature = "wgpu"))]
    pub(super) fn all_disparities(&self) -> Vec<f32> {
        let (count, pixels) = (self.num_candidates(), self.num_pixels());
        let mut all = vec![0.0; self.num_views() * count * pixels];
        all.par_chunks_mut(pixels.max(1)).enumerate().for_each(|(map, all)| {
            let (view, candidate) = (map / count, map % count);
            all.iter_mut().enumerate().for_each(|(pixel, all)| *all = self.disparity(view, candidate, pixel));
        });
        all
    }

    /// The candidates of a pixel that the neighbour can see, in order. They are listed before any vector
    /// arithmetic: vector code inside a callback would not be compiled for the machine's vectors.
    fn samples(&self, view: usize, warp: &Warp, x: usize, y: usize, samples: &mut Vec<Sample>) {
        samples.clear();
        let pixel = [x as f32, y as f32, 1.0];
        let far: [f32; 3] = warp.rotation.map(|row| row[0] * pixel[0] + row[1] * pixel[1] + row[2]);
        let pixel_index = y * self.width + x;
        for candidate in 0..self.disparities[view].len() {
            let disparity = self.disparity(view, candidate, pixel_index);
            let q: [f32; 3] = std::array::from_fn(|i| far[i] + disparity * warp.translation[i]);
            if q[2] > MIN_DEPTH_RATIO {
                let (x, y) = (q[0] / q[2], q[1] / q[2]);
                if x > -1.0 && y > -1.0 && x < self.width as f32 && y < self.height as f32 {
                    samples.push(Sample::at(candidate, x, y));
                }
            }
        }
    }

    /// Pixel indices of the four corners of a cell; `None` where a corner lies outside the map.
    #[inline(always)]
    fn corners(&self, cell: (i32, i32)) -> [Option<usize>; 4] {
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| {
            let (x, y) = (cell.0 + dx, cell.1 + dy);
            let inside = x >= 0 && y >= 0 && (x as usize) < self.width && (y as usize) < self.height;
            inside.then(|| y as usize * self.width + x as usize)
        })
    }
}

/// A bilinear sample: the cell it falls into and the weights of the cell's corners.
#[derive(Clone, Copy)]
struct Sample {
    candidate: usize,
    cell: (i32, i32),
    weights: [f32; 4],
}

impl Sample {
    #[inline(always)]
    fn at(candidate: usize, x: f32, y: f32) -> Self {
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        Self { candidate, cell: (x0 as i32, y0 as i32), weights }
    }
}

/// Correlations `[views, height, candidates, width]` of pixel-major features `[views, height, width, channels]`.
pub fn forward(features: &[f32], channels: usize, sweep: &Sweep) -> Vec<f32> {
    let row_len = sweep.num_candidates() * sweep.width;
    let mut output = vec![0.0; sweep.num_views() * sweep.height * row_len];
    if row_len > 0 {
        output.par_chunks_mut(row_len).enumerate().for_each(|(i, output)| {
            let (view, y) = (i / sweep.height, i % sweep.height);
            Arch::new().dispatch(ForwardRow { features, channels, sweep, view, y, output });
        });
    }
    output
}

struct ForwardRow<'a> {
    features: &'a [f32],
    channels: usize,
    sweep: &'a Sweep,
    view: usize,
    y: usize,
    output: &'a mut [f32],
}

impl WithSimd for ForwardRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { features, channels, sweep, view, y, output } = self;
        let warps = &sweep.warps[view];
        let factor = normaliser(channels, warps.len());
        let mut samples = Vec::with_capacity(sweep.num_candidates());
        for x in 0..sweep.width {
            let reference = pixel(features, channels, view * sweep.num_pixels() + y * sweep.width + x);
            for warp in warps {
                let map = warp.other * sweep.num_pixels();
                sweep.samples(view, warp, x, y, &mut samples);
                let (mut cell, mut products) = (None, [0.0f32; 4]);
                for sample in &samples {
                    if cell != Some(sample.cell) {
                        cell = Some(sample.cell);
                        let corners = sweep.corners(sample.cell);
                        for i in 0..4 {
                            products[i] = match corners[i] {
                                Some(p) => dot(simd, reference, pixel(features, channels, map + p)),
                                None => 0.0,
                            };
                        }
                    }
                    let value: f32 = products.iter().zip(sample.weights).map(|(p, w)| p * w).sum();
                    output[sample.candidate * sweep.width + x] += factor * value;
                }
            }
        }
    }
}

/// Gradient with respect to the features, given that of [`forward`]'s output; both in their own layouts.
pub fn backward(features: &[f32], channels: usize, sweep: &Sweep, grad: &[f32]) -> Vec<f32> {
    let num_chunks = channels.div_ceil(CHUNK).max(1);
    let parts: Vec<Vec<f32>> = (0..sweep.num_views() * num_chunks)
        .into_par_iter()
        .map(|task| {
            let (view, first) = (task / num_chunks, task % num_chunks * CHUNK);
            let len = CHUNK.min(channels - first);
            let mut output = vec![0.0; sweep.num_pixels() * len];
            Arch::new().dispatch(BackwardChunk {
                features,
                channels,
                sweep,
                grad,
                view,
                first,
                len,
                output: &mut output,
            });
            output
        })
        .collect();
    let mut output = vec![0.0; features.len()];
    for (task, part) in parts.iter().enumerate() {
        let (view, first) = (task / num_chunks, task % num_chunks * CHUNK);
        let len = CHUNK.min(channels - first);
        let map = &mut output[view * sweep.num_pixels() * channels..][..sweep.num_pixels() * channels];
        for (target, source) in map.chunks_exact_mut(channels).zip(part.chunks_exact(len)) {
            target[first..first + len].copy_from_slice(source);
        }
    }
    output
}

/// The gradient of some channels of one view: as reference, and as neighbour of the others.
struct BackwardChunk<'a> {
    features: &'a [f32],
    channels: usize,
    sweep: &'a Sweep,
    grad: &'a [f32],
    view: usize,
    first: usize,
    len: usize,
    output: &'a mut [f32],
}

impl WithSimd for BackwardChunk<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { features, channels, sweep, grad, view, first, len, output } = self;
        let mut samples = Vec::with_capacity(sweep.num_candidates());
        for (reference, warps) in sweep.warps.iter().enumerate() {
            let factor = normaliser(channels, warps.len());
            for warp in warps.iter().filter(|warp| reference == view || warp.other == view) {
                let map = warp.other * sweep.num_pixels();
                for p in 0..sweep.num_pixels() {
                    let (x, y) = (p % sweep.width, p / sweep.width);
                    let here = reference * sweep.num_pixels() + p;
                    let row = (reference * sweep.height + y) * sweep.num_candidates();
                    sweep.samples(reference, warp, x, y, &mut samples);
                    for run in samples.chunk_by(|a, b| a.cell == b.cell) {
                        let mut sums = [0.0f32; 4];
                        for sample in run {
                            let g = factor * grad[(row + sample.candidate) * sweep.width + x];
                            for i in 0..4 {
                                sums[i] += g * sample.weights[i];
                            }
                        }
                        let corners = sweep.corners(run[0].cell);
                        for i in 0..4 {
                            let Some(corner) = corners[i] else { continue };
                            if reference == view {
                                let source = &pixel(features, channels, map + corner)[first..first + len];
                                add_scaled(simd, &mut output[p * len..][..len], sums[i], source);
                            }
                            if warp.other == view {
                                let source = &pixel(features, channels, here)[first..first + len];
                                add_scaled(simd, &mut output[corner * len..][..len], sums[i], source);
                            }
                        }
                    }
                }
            }
        }
    }
}

/// `1 / sqrt(C)`, and the mean over the neighbours.
pub(super) fn normaliser(channels: usize, num_neighbours: usize) -> f32 {
    1.0 / ((channels as f32).sqrt() * num_neighbours.max(1) as f32)
}

#[inline(always)]
fn pixel(features: &[f32], channels: usize, index: usize) -> &[f32] {
    &features[index * channels..][..channels]
}
