//! Attention of each surfel over the pixels of its footprints (spec 2.7.4, 11.2; paper: the cross-view
//! feature aggregation over the regions `R_k`).
//!
//! Fused: scores are streamed with a running maximum, so nothing of size surfels x views x samples x
//! channels is ever stored. Invariant: a surfel without samples yields zero; all others a convex
//! combination of the values in its regions.

use super::vector::{add_scaled, dot, scale};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Surfels per task of the passes that are parallel over surfels.
const BLOCK: usize = 512;

/// The sampled pixels of one surfel in one view: a square of `side` x `side` candidates, `step` pixels
/// apart, of which bit `row * side + column` of `mask` tells whether it belongs to the region.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Window {
    /// Column of the first candidate; may lie outside the image where the mask excludes it.
    pub x: i32,
    /// Row of the first candidate.
    pub y: i32,
    /// Pixels between neighbouring candidates.
    pub step: i32,
    /// The members.
    pub mask: u64,
}

/// Largest side whose mask fits.
pub const MAX_SIDE: usize = 8;

/// The regions of all surfels: one surfel per pixel of each view, view-major then row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Regions {
    /// Columns of each view.
    pub width: usize,
    /// Rows of each view.
    pub height: usize,
    /// Candidates per side of a window, at most [`MAX_SIDE`].
    pub side: usize,
    /// For each home view, the views its surfels look into (the home view first); equally many for all.
    pub targets: Vec<Vec<usize>>,
    /// `[surfel, target]`.
    pub windows: Vec<Window>,
}

impl Regions {
    /// Number of surfels.
    pub fn num_surfels(&self) -> usize {
        self.targets.len() * self.width * self.height
    }

    /// Views each surfel looks into.
    pub fn num_targets(&self) -> usize {
        self.targets.first().map_or(0, Vec::len)
    }

    /// Lists the index (view-major) of each sampled pixel of `surfel`, in a fixed order. Listed rather than
    /// visited: vector code inside a callback would not be compiled for the machine's vectors.
    pub fn pixels(&self, surfel: usize, pixels: &mut Vec<usize>) {
        pixels.clear();
        for slot in 0..self.num_targets() {
            self.append_pixels(surfel, slot, pixels);
        }
    }

    fn append_pixels(&self, surfel: usize, slot: usize, pixels: &mut Vec<usize>) {
        let view = self.targets[surfel / (self.width * self.height)][slot];
        let window = self.windows[surfel * self.num_targets() + slot];
        let mut mask = window.mask;
        while mask != 0 {
            let bit = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            let x = window.x + (bit % self.side) as i32 * window.step;
            let y = window.y + (bit / self.side) as i32 * window.step;
            pixels.push((view * self.height + y as usize) * self.width + x as usize);
        }
    }
}

/// Queries, keys and values, each `[surfels, channels]` with the heads one after the other.
#[derive(Clone, Copy)]
pub struct Inputs<'a> {
    /// What a surfel asks.
    pub query: &'a [f32],
    /// What a pixel answers to.
    pub key: &'a [f32],
    /// What a pixel gives.
    pub value: &'a [f32],
    /// Values per surfel or pixel.
    pub channels: usize,
    /// Heads; divides `channels`.
    pub num_heads: usize,
}

impl Inputs<'_> {
    fn head_dim(&self) -> usize {
        self.channels / self.num_heads
    }

    fn score_scale(&self) -> f32 {
        1.0 / (self.head_dim() as f32).sqrt()
    }
}

/// Gradients with the shapes of [`Inputs`].
pub struct Gradients {
    /// Of the queries.
    pub query: Vec<f32>,
    /// Of the keys.
    pub key: Vec<f32>,
    /// Of the values.
    pub value: Vec<f32>,
}

/// Attended values `[surfels, channels]`.
pub fn forward(inputs: &Inputs, regions: &Regions) -> Vec<f32> {
    let mut output = vec![0.0; regions.num_surfels() * inputs.channels];
    output.par_chunks_mut(BLOCK * inputs.channels).enumerate().for_each(|(block, output)| {
        Arch::new().dispatch(ForwardBlock { inputs, regions, first: block * BLOCK, output });
    });
    output
}

struct ForwardBlock<'a> {
    inputs: &'a Inputs<'a>,
    regions: &'a Regions,
    first: usize,
    output: &'a mut [f32],
}

impl WithSimd for ForwardBlock<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { inputs, regions, first, output } = self;
        let (channels, dim) = (inputs.channels, inputs.head_dim());
        let mut running = vec![(f32::NEG_INFINITY, 0.0f32); inputs.num_heads];
        let mut pixels = Vec::new();
        for (i, output) in output.chunks_exact_mut(channels).enumerate() {
            let query = &inputs.query[(first + i) * channels..][..channels];
            running.fill((f32::NEG_INFINITY, 0.0));
            regions.pixels(first + i, &mut pixels);
            for &pixel in &pixels {
                let key = &inputs.key[pixel * channels..][..channels];
                let value = &inputs.value[pixel * channels..][..channels];
                for (head, (maximum, sum)) in running.iter_mut().enumerate() {
                    let part = head * dim..(head + 1) * dim;
                    let score = inputs.score_scale() * dot(simd, &query[part.clone()], &key[part.clone()]);
                    if score > *maximum {
                        let shrink = (*maximum - score).exp();
                        *sum *= shrink;
                        scale(simd, &mut output[part.clone()], shrink);
                        *maximum = score;
                    }
                    let weight = (score - *maximum).exp();
                    *sum += weight;
                    add_scaled(simd, &mut output[part.clone()], weight, &value[part]);
                }
            }
            for (head, &(_, sum)) in running.iter().enumerate().filter(|(_, (_, sum))| *sum > 0.0) {
                scale(simd, &mut output[head * dim..(head + 1) * dim], 1.0 / sum);
            }
        }
    }
}

/// Softmax statistics of one surfel and head, kept between the two passes of [`backward`].
#[derive(Clone, Copy, Default)]
struct Statistics {
    /// Log of the sum of exponentials.
    log_sum: f32,
    /// `y . dy`: the mean of `value . dy` under the attention weights.
    mean: f32,
}

/// Gradients of a loss whose gradient with respect to [`forward`]'s output is `grad`.
pub fn backward(inputs: &Inputs, regions: &Regions, grad: &[f32]) -> Gradients {
    let (channels, heads) = (inputs.channels, inputs.num_heads);
    let mut query = vec![0.0; inputs.query.len()];
    let mut statistics = vec![Statistics::default(); regions.num_surfels() * heads];
    query.par_chunks_mut(BLOCK * channels).zip(statistics.par_chunks_mut(BLOCK * heads)).enumerate().for_each(
        |(block, (query_grad, statistics))| {
            let first = block * BLOCK;
            Arch::new().dispatch(QueryBlock { inputs, regions, grad, first, query_grad, statistics });
        },
    );
    let num_views = regions.targets.len();
    let parts: Vec<(Vec<f32>, Vec<f32>)> = (0..num_views * heads)
        .into_par_iter()
        .map(|task| {
            let len = regions.width * regions.height * inputs.head_dim();
            let (mut key, mut value) = (vec![0.0; len], vec![0.0; len]);
            let (view, head) = (task / heads, task % heads);
            let statistics = &statistics;
            Arch::new().dispatch(ScatterHead {
                inputs,
                regions,
                grad,
                statistics,
                view,
                head,
                key: &mut key,
                value: &mut value,
            });
            (key, value)
        })
        .collect();
    let interleave = |select: fn(&(Vec<f32>, Vec<f32>)) -> &Vec<f32>| {
        let mut output = vec![0.0; inputs.key.len()];
        let (dim, map_len) = (inputs.head_dim(), regions.width * regions.height * channels);
        for (task, part) in parts.iter().enumerate() {
            let map = &mut output[task / heads * map_len..][..map_len];
            for (target, source) in map.chunks_exact_mut(channels).zip(select(part).chunks_exact(dim)) {
                target[task % heads * dim..][..dim].copy_from_slice(source);
            }
        }
        output
    };
    Gradients { query, key: interleave(|p| &p.0), value: interleave(|p| &p.1) }
}

/// First pass: query gradients and softmax statistics of consecutive surfels.
struct QueryBlock<'a> {
    inputs: &'a Inputs<'a>,
    regions: &'a Regions,
    grad: &'a [f32],
    first: usize,
    query_grad: &'a mut [f32],
    statistics: &'a mut [Statistics],
}

impl WithSimd for QueryBlock<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { inputs, regions, grad, first, query_grad, statistics } = self;
        let (channels, heads, dim) = (inputs.channels, inputs.num_heads, inputs.head_dim());
        // Pixel, score, and value . dy of each sample of one surfel and head.
        let mut samples: Vec<(usize, f32, f32)> = Vec::new();
        let mut pixels = Vec::new();
        for (i, target) in query_grad.chunks_exact_mut(channels).enumerate() {
            let surfel = first + i;
            regions.pixels(surfel, &mut pixels);
            for head in 0..heads {
                let at = |values: &'_ [f32], index: usize| index * channels + head * dim..values.len();
                let query = &inputs.query[at(inputs.query, surfel)][..dim];
                let dy = &grad[at(grad, surfel)][..dim];
                samples.clear();
                for &pixel in &pixels {
                    let key = &inputs.key[at(inputs.key, pixel)][..dim];
                    let value = &inputs.value[at(inputs.value, pixel)][..dim];
                    samples.push((pixel, inputs.score_scale() * dot(simd, query, key), dot(simd, value, dy)));
                }
                let maximum = samples.iter().fold(f32::NEG_INFINITY, |m, s| m.max(s.1));
                let sum: f32 = samples.iter().map(|s| (s.1 - maximum).exp()).sum();
                let log_sum = maximum + sum.ln();
                let mean = samples.iter().map(|s| (s.1 - log_sum).exp() * s.2).sum();
                statistics[i * heads + head] = Statistics { log_sum, mean };
                for &(pixel, score, product) in &samples {
                    let d_score = (score - log_sum).exp() * (product - mean) * inputs.score_scale();
                    let key = &inputs.key[at(inputs.key, pixel)][..dim];
                    add_scaled(simd, &mut target[head * dim..][..dim], d_score, key);
                }
            }
        }
    }
}

/// Second pass: key and value gradients of one view and head, from all surfels that look into it.
struct ScatterHead<'a> {
    inputs: &'a Inputs<'a>,
    regions: &'a Regions,
    grad: &'a [f32],
    statistics: &'a [Statistics],
    view: usize,
    head: usize,
    key: &'a mut [f32],
    value: &'a mut [f32],
}

impl WithSimd for ScatterHead<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { inputs, regions, grad, statistics, view, head, key, value } = self;
        let (channels, dim, num_pixels) = (inputs.channels, inputs.head_dim(), regions.width * regions.height);
        let mut pixels = Vec::new();
        for (home, targets) in regions.targets.iter().enumerate() {
            for (slot, _) in targets.iter().enumerate().filter(|&(_, &target)| target == view) {
                for surfel in home * num_pixels..(home + 1) * num_pixels {
                    let start = surfel * channels + head * dim;
                    let (query, dy) = (&inputs.query[start..][..dim], &grad[start..][..dim]);
                    let Statistics { log_sum, mean } = statistics[surfel * inputs.num_heads + head];
                    pixels.clear();
                    regions.append_pixels(surfel, slot, &mut pixels);
                    for &pixel in &pixels {
                        let start = pixel * channels + head * dim;
                        let score = inputs.score_scale() * dot(simd, query, &inputs.key[start..][..dim]);
                        let weight = (score - log_sum).exp();
                        let product = dot(simd, &inputs.value[start..][..dim], dy);
                        let local = (pixel - view * num_pixels) * dim;
                        add_scaled(simd, &mut value[local..][..dim], weight, dy);
                        let d_score = weight * (product - mean) * inputs.score_scale();
                        add_scaled(simd, &mut key[local..][..dim], d_score, query);
                    }
                }
            }
        }
    }
}
