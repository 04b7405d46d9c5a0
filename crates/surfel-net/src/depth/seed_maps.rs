//! Seeds as the tensors a network reads, and the proposals of plane propagation.
//!
//! Invariant: nothing here carries a gradient, and every input is in steps, correlations or shares.

use super::SceneGeometry;
use super::cross_view::{CrossView, SAID};
use super::likeness::{LIKENESS, Likeness};
use super::passes::Given;
use crate::layers::space_to_depth;
use crate::ops::propagate::{Proposals, clamped, soft};
use crate::seed::Seed;
use burn::tensor::{Device, Tensor, TensorData};
use rayon::prelude::*;
use std::sync::Arc;

/// Maps that every pixel of a block gives of its own: offset and weight of the evidence, correlation, confidence, and
/// what the neighbours say of its plane.
const PER_PIXEL: usize = 4 + SAID;
/// Slopes that a block gives.
const SLOPES: usize = 2;
/// The number of the pass, the same everywhere.
const NUMBER: usize = 1;
/// Values known of a proposal.
pub(crate) const KNOWN: usize = 5 + SAID + LIKENESS;

/// What the refinement needs of the seeds of all views, at the padded size.
pub(crate) struct SeedMaps {
    /// Inputs of the U-Net, `[views, channels, height / stride, width / stride]`.
    pub(crate) inputs: Tensor<4>,
    /// Of the planes to start from, in \[0, 1\], `[views, 1, height, width]`.
    pub(crate) confidence: Tensor<4>,
    /// Of the planes to start from, 1 / scene unit, `[views, 1, height, width]`.
    pub(crate) inverse_depth: Tensor<4>,
    /// What matching said, where that is not what to start from: confidence and inverse depth, as above.
    pub(crate) matched: Option<[Tensor<4>; 2]>,
    /// Inverse depth of a step, `[views, 1, 1, 1]`.
    pub(crate) steps: Tensor<4>,
    pub(super) step_of_view: Vec<f32>,
    /// What is known of each proposal, `[views, proposals, KNOWN, height / stride, width / stride]`.
    pub(crate) known: Tensor<5>,
    /// The planes and where they propose to.
    pub(crate) proposals: Arc<Proposals>,
}

impl SeedMaps {
    /// Channels of `inputs`.
    pub(crate) fn channels(stride: usize, num_proposals: usize) -> usize {
        PER_PIXEL * stride * stride + SLOPES + 2 * (num_proposals - 1) + NUMBER
    }

    /// Of what a pass starts from, padded as `given` is. `pass` counts the passes before: the network is told, for
    /// confidence means less where matching states it.
    pub(crate) fn new(seeds: &[Seed], pass: usize, given: &Given, scene: &SceneGeometry, device: &Device) -> Self {
        let stride = given.stride;
        let (width, height) = (seeds[0].planes.width(), seeds[0].planes.height());
        let views = seeds.len();
        let planes: Vec<[f32; 3]> = seeds.iter().flat_map(Seed::planes_in_steps).collect();
        let proposals = Proposals { width, height, stride, planes, offsets: given.offsets.clone() };
        let full = |channels: usize, values: Vec<f32>| -> Tensor<4> {
            Tensor::from_data(TensorData::new(values, [views, channels, height, width]), device)
        };
        let cross_view = CrossView::new(scene.cameras, scene.neighbours, seeds);
        let per_pixel: Vec<f32> = (0..views).flat_map(|view| pixel_maps(&seeds[view], view, &cross_view)).collect();
        let blocks = block_maps(&proposals, seeds);
        let (columns, rows) = proposals.weight_size();
        let block_channels = SLOPES + 2 * (proposals.offsets.len() - 1);
        let blocks = Tensor::from_data(TensorData::new(blocks, [views, block_channels, rows, columns]), device);
        let number = Tensor::full([views, NUMBER, rows, columns], pass as f32, device);
        let step_of_view: Vec<f32> = seeds.iter().map(|seed| seed.step).collect();
        let confidence =
            |seeds: &[Seed]| full(1, seeds.iter().flat_map(|s| s.confidence.as_slice()).copied().collect());
        let inverse_depth =
            |seeds: &[Seed]| full(1, seeds.iter().flat_map(|s| s.planes.as_slice()).map(|p| p[0]).collect());
        Self {
            inputs: Tensor::cat(vec![space_to_depth(full(PER_PIXEL, per_pixel), stride), blocks, number], 1),
            confidence: confidence(seeds),
            inverse_depth: inverse_depth(seeds),
            matched: (pass > 0).then(|| [confidence(given.matched), inverse_depth(given.matched)]),
            known: known(&proposals, seeds, &given.likenesses, &cross_view, device),
            steps: Tensor::<1>::from_floats(step_of_view.as_slice(), device).reshape([views, 1, 1, 1]),
            step_of_view,
            proposals: Arc::new(proposals),
        }
    }

    /// What is tried at each block: its own plane moved by `offsets` steps, then the planes proposed to it. Inverse
    /// depth at the pixel the block's features stand over, 1 / scene unit, `[views, tries, rows, columns]`.
    pub(crate) fn tries(&self, offsets: &[f32]) -> Vec<f32> {
        let Proposals { width, height, stride, ref planes, .. } = *self.proposals;
        let mut tries = Vec::new();
        for (view, step) in self.step_of_view.iter().enumerate() {
            let mut push = |value: &dyn Fn(usize, usize) -> f32| {
                for y in (0..height).step_by(stride) {
                    tries.extend((0..width).step_by(stride).map(|x| {
                        let own = planes[(view * height + y) * width + x][0];
                        step * (own + value(x, y))
                    }));
                }
            };
            offsets.iter().for_each(|offset| push(&|_, _| *offset));
            (1..self.proposals.offsets.len()).for_each(|k| push(&|x, y| self.proposals.at(view, x, y, k)[0]));
        }
        tries
    }
}

/// `[PER_PIXEL, height, width]` of one view.
fn pixel_maps(seed: &Seed, view: usize, cross_view: &CrossView) -> Vec<f32> {
    let (width, pixels) = (seed.planes.width(), seed.planes.len());
    let mut maps = Vec::with_capacity(PER_PIXEL * pixels);
    let evidence = seed.evidence.as_slice().iter().zip(seed.planes.as_slice());
    maps.extend(evidence.map(|(evidence, plane)| soft((evidence[0] - plane[0]) / seed.step)));
    maps.extend(seed.evidence.as_slice().iter().map(|evidence| evidence[1].max(0.0).ln_1p()));
    maps.extend_from_slice(seed.correlation.as_slice());
    maps.extend_from_slice(seed.confidence.as_slice());
    let say = |i: usize| cross_view.of(view, i % width, i / width, seed.planes.as_slice()[i][0]);
    let said: Vec<[f32; SAID]> = (0..pixels).into_par_iter().map(say).collect();
    (0..SAID).for_each(|c| maps.extend(said.iter().map(|said| said[c])));
    maps
}

/// `[views, slopes, differences to the proposals, their confidences; rows, columns]`, block means.
fn block_maps(proposals: &Proposals, seeds: &[Seed]) -> Vec<f32> {
    let (width, height) = (proposals.width, proposals.height);
    let count = proposals.offsets.len();
    let mut maps = Vec::new();
    for (view, seed) in seeds.iter().enumerate() {
        let own = &proposals.planes[view * width * height..][..width * height];
        for axis in [1, 2] {
            let slopes: Vec<f32> = own.iter().map(|plane| soft(4.0 * plane[axis])).collect();
            maps.extend(block_means(&slopes, proposals));
        }
        let over = |value: &dyn Fn(usize, usize) -> f32| -> Vec<f32> {
            block_means(&(0..width * height).map(|i| value(i % width, i / width)).collect::<Vec<_>>(), proposals)
        };
        for k in 1..count {
            maps.extend(over(&|x, y| soft(proposals.at(view, x, y, k)[0])));
        }
        for k in 1..count {
            let [dx, dy] = proposals.offsets[k];
            maps.extend(over(&|x, y| seed.confidence[(clamped(x, dx, width), clamped(y, dy, height))]));
        }
    }
    maps
}

/// What is known of each proposal at the pixel its block's features stand over: difference to the pixel's own plane,
/// its size, confidence at the proposer, support, whether it is the pixel's own, what the neighbours say of it, and how
/// alike pixel and proposer look.
fn known(
    proposals: &Proposals,
    seeds: &[Seed],
    likenesses: &[Likeness],
    cross_view: &CrossView,
    device: &Device,
) -> Tensor<5> {
    let stride = proposals.stride;
    let (columns, rows) = proposals.weight_size();
    let (count, blocks) = (proposals.offsets.len(), rows * columns);
    let of_block = |i: usize| -> Vec<[f32; KNOWN]> {
        let (view, block) = (i / blocks, i % blocks);
        let pixel = (block % columns * stride, block / columns * stride);
        known_at(proposals, seeds, &likenesses[view], cross_view, view, pixel)
    };
    let of_blocks: Vec<Vec<[f32; KNOWN]>> = (0..seeds.len() * blocks).into_par_iter().map(of_block).collect();
    let mut maps = Vec::with_capacity(seeds.len() * count * KNOWN * blocks);
    for of_view in of_blocks.chunks_exact(blocks) {
        for k in 0..count {
            (0..KNOWN).for_each(|c| maps.extend(of_view.iter().map(|known| known[k][c])));
        }
    }
    Tensor::from_data(TensorData::new(maps, [seeds.len(), count, KNOWN, rows, columns]), device)
}

/// One entry per proposal.
fn known_at(
    proposals: &Proposals,
    seeds: &[Seed],
    likeness: &Likeness,
    cross_view: &CrossView,
    view: usize,
    (x, y): (usize, usize),
) -> Vec<[f32; KNOWN]> {
    let seed = &seeds[view];
    let count = proposals.offsets.len();
    let differences: Vec<f32> = (0..count).map(|k| proposals.at(view, x, y, k)[0]).collect();
    let proposer = |[dx, dy]: &[i32; 2]| (clamped(x, *dx, proposals.width), clamped(y, *dy, proposals.height));
    let confidences: Vec<f32> = proposals.offsets.iter().map(|offset| seed.confidence[proposer(offset)]).collect();
    let of_proposal = |k: usize| {
        // Proposals within about a step of this one speak for it, as sure as they are.
        let agree = |j: usize| confidences[j] / (1.0 + (differences[j] - differences[k]).powi(2));
        let support = (0..count).map(agree).sum::<f32>() / count as f32;
        let difference = soft(differences[k]);
        let own = if k == 0 { 1.0 } else { 0.0 };
        let inverse_depth = seed.planes[(x, y)][0] + differences[k] * seed.step;
        let [confirmed, front, behind] = cross_view.of(view, x, y, inverse_depth);
        let [colour, edge] = likeness.of((x, y), proposals.offsets[k]);
        let size = difference.abs();
        [difference, size, confidences[k], support, own, confirmed, front, behind, colour, edge]
    };
    (0..count).map(of_proposal).collect()
}

/// Means over blocks of `[anything, height, width]`.
fn block_means(values: &[f32], proposals: &Proposals) -> Vec<f32> {
    let (width, height, stride) = (proposals.width, proposals.height, proposals.stride);
    let (columns, rows) = proposals.weight_size();
    let share = 1.0 / (stride * stride) as f32;
    let mut means = vec![0.0f32; values.len() / (stride * stride)];
    for (map, means) in values.chunks_exact(width * height).zip(means.chunks_exact_mut(columns * rows)) {
        for (y, row) in map.chunks_exact(width).enumerate() {
            let means = &mut means[y / stride * columns..][..columns];
            row.iter().enumerate().for_each(|(x, value)| means[x / stride] += share * value);
        }
    }
    means
}
