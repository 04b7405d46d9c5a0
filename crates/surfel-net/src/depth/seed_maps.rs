//! Seeds as the tensors a network reads, and the proposals of plane propagation.
//!
//! Invariant: nothing here carries a gradient, and every input is in steps, correlations or shares.

use super::patches::patches;
use crate::layers::space_to_depth;
use crate::ops::propagate::Proposals;
use crate::seed::Seed;
use burn::tensor::{Device, Tensor, TensorData};
use std::sync::Arc;
use surfel_core::Grid;

/// Maps that every pixel of a block gives of its own: offset and weight of the evidence, correlation, confidence.
const PER_PIXEL: usize = 4;
/// Slopes that a block gives.
const SLOPES: usize = 2;
/// Values known of a proposal.
pub(crate) const KNOWN: usize = 5;
/// Steps at which a difference counts half of what it could.
const SOFT_STEPS: f32 = 2.0;

/// What the refinement needs of the seeds of all views, at the padded size.
pub(crate) struct SeedMaps {
    /// Inputs of the U-Net, `[views, channels, height / stride, width / stride]`.
    pub(crate) inputs: Tensor<4>,
    /// Score of the density before the network's say, `[views, 1, height, width]`.
    pub(crate) confidence_score: Tensor<4>,
    /// Inverse depth, 1 / scene unit, `[views, 1, height, width]`.
    pub(crate) inverse_depth: Tensor<4>,
    /// Inverse depth of a step, `[views, 1, 1, 1]`.
    pub(crate) steps: Tensor<4>,
    step_of_view: Vec<f32>,
    /// What is known of each proposal, `[views, proposals, KNOWN, height / stride, width / stride]`.
    pub(crate) known: Tensor<5>,
    /// Windows of the photographs, see [`patches`].
    pub(crate) patches: Tensor<4>,
    /// The planes and where they propose to.
    pub(crate) proposals: Arc<Proposals>,
}

impl SeedMaps {
    /// Channels of `inputs`.
    pub(crate) fn channels(stride: usize, num_proposals: usize) -> usize {
        PER_PIXEL * stride * stride + SLOPES + 2 * (num_proposals - 1)
    }

    /// Of seeds and images padded to a multiple of the stride; `offsets` begins with the pixel itself.
    pub(crate) fn new(
        seeds: &[Seed],
        images: &[Grid<[f32; 3]>],
        offsets: Vec<[i32; 2]>,
        stride: usize,
        device: &Device,
    ) -> Self {
        let (width, height) = (seeds[0].planes.width(), seeds[0].planes.height());
        let (views, pixels) = (seeds.len(), width * height);
        let planes: Vec<[f32; 3]> = seeds.iter().flat_map(Seed::planes_in_steps).collect();
        let proposals = Proposals { width, height, stride, planes, offsets };
        let full = |channels: usize, values: Vec<f32>| -> Tensor<4> {
            Tensor::from_data(TensorData::new(values, [views, channels, height, width]), device)
        };
        let per_pixel: Vec<f32> = seeds.iter().flat_map(|seed| pixel_maps(seed, pixels)).collect();
        let blocks = block_maps(&proposals, seeds);
        let (columns, rows) = proposals.weight_size();
        let block_channels = SLOPES + 2 * (proposals.offsets.len() - 1);
        let blocks = Tensor::from_data(TensorData::new(blocks, [views, block_channels, rows, columns]), device);
        let score = |confidence: &f32| 4.0 * confidence - 2.0;
        let step_of_view: Vec<f32> = seeds.iter().map(|seed| seed.step).collect();
        let inverse_depth: Vec<f32> = seeds.iter().flat_map(|s| s.planes.as_slice().iter().map(|p| p[0])).collect();
        Self {
            inputs: Tensor::cat(vec![space_to_depth(full(PER_PIXEL, per_pixel), stride), blocks], 1),
            confidence_score: full(1, seeds.iter().flat_map(|s| s.confidence.as_slice().iter().map(score)).collect()),
            known: known(&proposals, seeds, device),
            patches: patches(images, stride, device),
            inverse_depth: full(1, inverse_depth),
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
fn pixel_maps(seed: &Seed, pixels: usize) -> Vec<f32> {
    let mut maps = Vec::with_capacity(PER_PIXEL * pixels);
    let evidence = seed.evidence.as_slice().iter().zip(seed.planes.as_slice());
    maps.extend(evidence.map(|(evidence, plane)| soft((evidence[0] - plane[0]) / seed.step)));
    maps.extend(seed.evidence.as_slice().iter().map(|evidence| evidence[1].max(0.0).ln_1p()));
    maps.extend_from_slice(seed.correlation.as_slice());
    maps.extend_from_slice(seed.confidence.as_slice());
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
            maps.extend(over(&|x, y| {
                let at = |at: usize, by: i32, len: usize| (at as i64 + i64::from(by)).clamp(0, len as i64 - 1) as usize;
                seed.confidence[(at(x, dx, width), at(y, dy, height))]
            }));
        }
    }
    maps
}

/// What is known of each proposal at the pixel its block's features stand over: difference to the pixel's own plane,
/// its size, confidence at the proposer, support, and whether it is the pixel's own.
fn known(proposals: &Proposals, seeds: &[Seed], device: &Device) -> Tensor<5> {
    let (width, height, stride) = (proposals.width, proposals.height, proposals.stride);
    let (columns, rows) = proposals.weight_size();
    let count = proposals.offsets.len();
    let mut maps = vec![0.0f32; seeds.len() * count * KNOWN * rows * columns];
    let at = |at: usize, by: i32, len: usize| (at as i64 + i64::from(by)).clamp(0, len as i64 - 1) as usize;
    for (view, (seed, maps)) in seeds.iter().zip(maps.chunks_exact_mut(count * KNOWN * rows * columns)).enumerate() {
        let mut differences = vec![0.0f32; count];
        let mut confidences = vec![0.0f32; count];
        for block in 0..rows * columns {
            let (x, y) = (block % columns * stride, block / columns * stride);
            for (k, [dx, dy]) in proposals.offsets.iter().enumerate() {
                differences[k] = proposals.at(view, x, y, k)[0];
                confidences[k] = seed.confidence[(at(x, *dx, width), at(y, *dy, height))];
            }
            for k in 0..count {
                // Proposals within about a step of this one speak for it, as sure as they are.
                let agree = |j: usize| confidences[j] / (1.0 + (differences[j] - differences[k]).powi(2));
                let support = (0..count).map(agree).sum::<f32>() / count as f32;
                let difference = soft(differences[k]);
                let own = if k == 0 { 1.0 } else { 0.0 };
                for (c, value) in [difference, difference.abs(), confidences[k], support, own].into_iter().enumerate() {
                    maps[(k * KNOWN + c) * rows * columns + block] = value;
                }
            }
        }
    }
    Tensor::from_data(TensorData::new(maps, [seeds.len(), count, KNOWN, rows, columns]), device)
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

/// Odd, in (-1, 1), steepest at zero: small differences keep their size, large ones only their sign.
fn soft(steps: f32) -> f32 {
    steps / (SOFT_STEPS + steps.abs())
}
