//! Attention of each pixel over the samples of its epipolar lines (paper: the epipolar transformer in `Phi_image`).
//!
//! Keys and values are interpolated where a candidate of depth lands, and joined by what the candidate's own depth
//! says of itself. Fused: no sample's feature is stored, and time is linear in views times neighbours. Invariant:
//! what lies off a pixel's lines does not reach it; a pixel whose lines miss all neighbours gets zero.

use super::epipolar::{EpipolarLines, Landing};
use super::vector::{add_scaled, dot};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Pixels per task of the passes that are parallel over pixels.
const BLOCK: usize = 128;

/// Row-major, the heads of a row one after the other.
#[derive(Clone, Copy)]
pub struct Inputs<'a> {
    /// What a pixel asks, `[views, height, width, channels]`.
    pub query: &'a [f32],
    /// What a pixel answers to, of the same shape.
    pub key: &'a [f32],
    /// What a pixel gives, of the same shape.
    pub value: &'a [f32],
    /// Added to the key of a sample at each candidate of depth, `[candidates, channels]`.
    pub depth_key: &'a [f32],
    /// Added to its value, of the same shape.
    pub depth_value: &'a [f32],
    /// Values per row.
    pub channels: usize,
    /// Heads; divides `channels`.
    pub num_heads: usize,
}

impl<'a> Inputs<'a> {
    fn head_dim(&self) -> usize {
        self.channels / self.num_heads
    }

    fn score_scale(&self) -> f32 {
        1.0 / (self.head_dim() as f32).sqrt()
    }

    #[inline(always)]
    fn row(&self, values: &'a [f32], row: usize, head: usize) -> &'a [f32] {
        &values[row * self.channels + head * self.head_dim()..][..self.head_dim()]
    }

    /// `vector . (interpolated row of map + row of the candidate)`.
    #[inline(always)]
    fn product<S: Simd>(
        &self,
        simd: S,
        vector: &[f32],
        map: &'a [f32],
        depth: &'a [f32],
        at: &Landing,
        head: usize,
    ) -> f32 {
        let mut sum = dot(simd, vector, self.row(depth, at.candidate, head));
        for (&pixel, weight) in at.pixels.iter().zip(at.weights) {
            sum += weight * dot(simd, vector, self.row(map, pixel, head));
        }
        sum
    }

    #[inline(always)]
    fn score<S: Simd>(&self, simd: S, query: &[f32], at: &Landing, head: usize) -> f32 {
        self.score_scale() * self.product(simd, query, self.key, self.depth_key, at, head)
    }

    /// `target += factor (interpolated row of map + row of the candidate)`.
    #[inline(always)]
    fn add<S: Simd>(
        &self,
        simd: S,
        target: &mut [f32],
        factor: f32,
        map: &'a [f32],
        depth: &'a [f32],
        at: &Landing,
        head: usize,
    ) {
        add_scaled(simd, target, factor, self.row(depth, at.candidate, head));
        for (&pixel, weight) in at.pixels.iter().zip(at.weights) {
            add_scaled(simd, target, factor * weight, self.row(map, pixel, head));
        }
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
    /// Of what depths add to keys.
    pub depth_key: Vec<f32>,
    /// Of what depths add to values.
    pub depth_value: Vec<f32>,
}

/// Log of the sum of the exponentials of scores; minus infinity of none.
fn log_sum(scores: impl Iterator<Item = f32> + Clone) -> f32 {
    let maximum = scores.clone().fold(f32::NEG_INFINITY, f32::max);
    maximum + scores.map(|score| (score - maximum).exp()).sum::<f32>().ln()
}

/// Attended values `[views, height, width, channels]`.
pub fn forward(inputs: &Inputs, lines: &EpipolarLines) -> Vec<f32> {
    let mut output = vec![0.0; inputs.query.len()];
    output.par_chunks_mut(BLOCK * inputs.channels).enumerate().for_each(|(block, output)| {
        Arch::new().dispatch(ForwardBlock { inputs, lines, first: block * BLOCK, output });
    });
    output
}

struct ForwardBlock<'a> {
    inputs: &'a Inputs<'a>,
    lines: &'a EpipolarLines,
    first: usize,
    output: &'a mut [f32],
}

impl WithSimd for ForwardBlock<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { inputs, lines, first, output } = self;
        let dim = inputs.head_dim();
        let (mut landings, mut scores): (Vec<Landing>, Vec<f32>) = (Vec::new(), Vec::new());
        for (i, output) in output.chunks_exact_mut(inputs.channels).enumerate() {
            lines.landings(first + i, &mut landings);
            for (head, output) in output.chunks_exact_mut(dim).enumerate() {
                let query = inputs.row(inputs.query, first + i, head);
                scores.clear();
                for at in &landings {
                    scores.push(inputs.score(simd, query, at, head));
                }
                let log_sum = log_sum(scores.iter().copied());
                for (at, score) in landings.iter().zip(&scores) {
                    let weight = (score - log_sum).exp();
                    inputs.add(simd, output, weight, inputs.value, inputs.depth_value, at, head);
                }
            }
        }
    }
}

/// Softmax statistics of one pixel and head, kept between the two passes of [`backward`].
#[derive(Clone, Copy, Default)]
struct Statistics {
    /// Log of the sum of exponentials.
    log_sum: f32,
    /// `y . dy`: the mean of `value . dy` under the attention weights.
    mean: f32,
}

/// Gradients of a loss whose gradient with respect to [`forward`]'s output is `grad`.
pub fn backward(inputs: &Inputs, lines: &EpipolarLines, grad: &[f32]) -> Gradients {
    let (channels, heads, dim) = (inputs.channels, inputs.num_heads, inputs.head_dim());
    let mut query = vec![0.0; inputs.query.len()];
    let mut statistics = vec![Statistics::default(); inputs.query.len() / channels * heads];
    query.par_chunks_mut(BLOCK * channels).zip(statistics.par_chunks_mut(BLOCK * heads)).enumerate().for_each(
        |(block, (query_grad, statistics))| {
            let first = block * BLOCK;
            Arch::new().dispatch(QueryBlock { inputs, lines, grad, first, query_grad, statistics });
        },
    );
    let parts: Vec<Part> = (0..lines.num_views() * heads)
        .into_par_iter()
        .map(|task| {
            let (map, table) = (vec![0.0; lines.num_pixels() * dim], vec![0.0; lines.num_candidates() * dim]);
            let mut part = Part { key: map.clone(), value: map, depth_key: table.clone(), depth_value: table };
            let (statistics, view, head) = (&statistics, task / heads, task % heads);
            Arch::new().dispatch(ScatterHead { inputs, lines, grad, statistics, view, head, part: &mut part });
            part
        })
        .collect();
    // Maps stand side by side, tables of depth are sums over views.
    let gathered = |len: usize, rows_of_view: usize, select: fn(&Part) -> &[f32]| {
        let mut output = vec![0.0; len];
        for (task, part) in parts.iter().enumerate() {
            let rows = output[task / heads * rows_of_view * channels..].chunks_exact_mut(channels);
            for (row, source) in rows.zip(select(part).chunks_exact(dim)) {
                let target = &mut row[task % heads * dim..][..dim];
                target.iter_mut().zip(source).for_each(|(target, source)| *target += source);
            }
        }
        output
    };
    let (maps, tables) = (inputs.key.len(), inputs.depth_key.len());
    Gradients {
        query,
        key: gathered(maps, lines.num_pixels(), |part| &part.key),
        value: gathered(maps, lines.num_pixels(), |part| &part.value),
        depth_key: gathered(tables, 0, |part| &part.depth_key),
        depth_value: gathered(tables, 0, |part| &part.depth_value),
    }
}

/// First pass: query gradients and softmax statistics of consecutive pixels.
struct QueryBlock<'a> {
    inputs: &'a Inputs<'a>,
    lines: &'a EpipolarLines,
    grad: &'a [f32],
    first: usize,
    query_grad: &'a mut [f32],
    statistics: &'a mut [Statistics],
}

impl WithSimd for QueryBlock<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { inputs, lines, grad, first, query_grad, statistics } = self;
        let (heads, dim) = (inputs.num_heads, inputs.head_dim());
        let mut landings = Vec::new();
        // Score, and value . dy, of each sample of one pixel and head.
        let mut samples: Vec<(f32, f32)> = Vec::new();
        for (i, target) in query_grad.chunks_exact_mut(inputs.channels).enumerate() {
            lines.landings(first + i, &mut landings);
            for (head, target) in target.chunks_exact_mut(dim).enumerate() {
                let query = inputs.row(inputs.query, first + i, head);
                let dy = &grad[(first + i) * inputs.channels + head * dim..][..dim];
                samples.clear();
                for at in &landings {
                    let product = inputs.product(simd, dy, inputs.value, inputs.depth_value, at, head);
                    samples.push((inputs.score(simd, query, at, head), product));
                }
                let log_sum = log_sum(samples.iter().map(|sample| sample.0));
                let mean = samples.iter().map(|(score, product)| (score - log_sum).exp() * product).sum();
                statistics[i * heads + head] = Statistics { log_sum, mean };
                for (at, (score, product)) in landings.iter().zip(&samples) {
                    let d_score = (score - log_sum).exp() * (product - mean) * inputs.score_scale();
                    inputs.add(simd, target, d_score, inputs.key, inputs.depth_key, at, head);
                }
            }
        }
    }
}

/// What one view and head receive, `[pixels or candidates, head channels]`.
struct Part {
    key: Vec<f32>,
    value: Vec<f32>,
    depth_key: Vec<f32>,
    depth_value: Vec<f32>,
}

/// Second pass: gradients of one view's keys and values in one head, from all pixels whose lines run through it.
struct ScatterHead<'a> {
    inputs: &'a Inputs<'a>,
    lines: &'a EpipolarLines,
    grad: &'a [f32],
    statistics: &'a [Statistics],
    view: usize,
    head: usize,
    part: &'a mut Part,
}

impl WithSimd for ScatterHead<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { inputs, lines, grad, statistics, view, head, part } = self;
        let (dim, num_pixels) = (inputs.head_dim(), lines.num_pixels());
        let mut landings = Vec::new();
        for (home, warps) in lines.warps.iter().enumerate() {
            for (slot, _) in warps.iter().enumerate().filter(|(_, warp)| warp.other == view) {
                for pixel in home * num_pixels..(home + 1) * num_pixels {
                    landings.clear();
                    lines.append_landings(pixel, slot, &mut landings);
                    let query = inputs.row(inputs.query, pixel, head);
                    let dy = &grad[pixel * inputs.channels + head * dim..][..dim];
                    let Statistics { log_sum, mean } = statistics[pixel * inputs.num_heads + head];
                    for at in &landings {
                        let weight = (inputs.score(simd, query, at, head) - log_sum).exp();
                        let product = inputs.product(simd, dy, inputs.value, inputs.depth_value, at, head);
                        let d_score = weight * (product - mean) * inputs.score_scale();
                        add_scaled(simd, &mut part.depth_key[at.candidate * dim..][..dim], d_score, query);
                        add_scaled(simd, &mut part.depth_value[at.candidate * dim..][..dim], weight, dy);
                        for (&corner, share) in at.pixels.iter().zip(at.weights) {
                            let local = (corner - view * num_pixels) * dim;
                            add_scaled(simd, &mut part.key[local..][..dim], share * d_score, query);
                            add_scaled(simd, &mut part.value[local..][..dim], share * weight, dy);
                        }
                    }
                }
            }
        }
    }
}
