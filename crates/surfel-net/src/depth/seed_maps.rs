//! Seeds as the tensors a network reads, and the proposals of plane propagation.
//!
//! Invariant: nothing here carries a gradient, and every input is in steps, correlations or shares.

use super::SceneGeometry;
use super::cross_view::{CrossView, SAID};
use super::likeness::LIKENESS;
use super::passes::Given;
use crate::layers::space_to_depth;
use crate::ops::propagate::{Proposals, soft};
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
        let proposals = &*self.proposals;
        let (columns, rows) = proposals.weight_size();
        let count = offsets.len() + proposals.offsets.len() - 1;
        let mut tries = vec![0.0; self.step_of_view.len() * count * rows * columns];
        tries.par_chunks_mut(rows * columns).enumerate().for_each(|(i, tries)| {
            let (view, k) = (i / count, i % count);
            for (block, inverse_depth) in tries.iter_mut().enumerate() {
                let (x, y) = (block % columns * proposals.stride, block / columns * proposals.stride);
                let moved = match offsets.get(k) {
                    Some(offset) => *offset,
                    None => proposals.at(view, x, y, k - offsets.len() + 1)[0],
                };
                *inverse_depth = self.step_of_view[view] * (proposals.own(view, x, y)[0] + moved);
            }
        });
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
    let others = proposals.offsets.len() - 1;
    let channels = SLOPES + 2 * others;
    let of_map = |map: usize| {
        let (view, channel) = (map / channels, map % channels);
        match channel {
            0..SLOPES => block_means(proposals, |x, y| soft(4.0 * proposals.own(view, x, y)[1 + channel])),
            _ if channel < SLOPES + others => {
                block_means(proposals, |x, y| soft(proposals.at(view, x, y, channel - SLOPES + 1)[0]))
            }
            _ => {
                let confidence = &seeds[view].confidence;
                block_means(proposals, |x, y| confidence[proposals.proposer(x, y, channel - SLOPES - others + 1)])
            }
        }
    };
    (0..seeds.len() * channels).into_par_iter().flat_map_iter(of_map).collect()
}

/// What is known of each proposal at the pixel its block's features stand over: difference to the pixel's own plane,
/// its size, confidence at the proposer, support, whether it is the pixel's own, what the neighbours say of it, and how
/// alike pixel and proposer look.
fn known(
    proposals: &Proposals,
    seeds: &[Seed],
    likenesses: &[Vec<[f32; LIKENESS]>],
    cross_view: &CrossView,
    device: &Device,
) -> Tensor<5> {
    let stride = proposals.stride;
    let (columns, rows) = proposals.weight_size();
    let (count, blocks) = (proposals.offsets.len(), rows * columns);
    // Block by block first, for what is known of a proposal depends on the others.
    let mut of_blocks = vec![[0.0f32; KNOWN]; seeds.len() * blocks * count];
    of_blocks.par_chunks_mut(columns * count).enumerate().for_each(|(row, of_row)| {
        let (view, row) = (row / rows, row % rows);
        let likenesses = &likenesses[view][row * columns * count..][..columns * count];
        let mut of_block = OfBlock::new(count);
        for (column, known) in of_row.chunks_exact_mut(count).enumerate() {
            of_block.read(proposals, seeds, cross_view, view, (column * stride, row * stride));
            of_block.write(&likenesses[column * count..][..count], known);
        }
    });
    let mut maps = vec![0.0f32; seeds.len() * count * KNOWN * blocks];
    maps.par_chunks_mut(blocks).enumerate().for_each(|(map, values)| {
        let (view, k, value) = (map / (count * KNOWN), map / KNOWN % count, map % KNOWN);
        let of_view = &of_blocks[view * blocks * count..][..blocks * count];
        values.iter_mut().zip(of_view.iter().skip(k).step_by(count)).for_each(|(to, known)| *to = known[value]);
    });
    Tensor::from_data(TensorData::new(maps, [seeds.len(), count, KNOWN, rows, columns]), device)
}

/// The planes proposed to one block, by proposal.
struct OfBlock {
    /// To the pixel's own plane, steps.
    differences: Vec<f32>,
    /// At the proposers.
    confidences: Vec<f32>,
    /// By the others.
    supports: Vec<f32>,
    /// By the neighbours.
    said: Vec<[f32; SAID]>,
}

impl OfBlock {
    fn new(count: usize) -> Self {
        let zeros = || vec![0.0; count];
        Self { differences: zeros(), confidences: zeros(), supports: zeros(), said: vec![[0.0; SAID]; count] }
    }

    fn read(
        &mut self,
        proposals: &Proposals,
        seeds: &[Seed],
        cross_view: &CrossView,
        view: usize,
        (x, y): (usize, usize),
    ) {
        let (seed, count) = (&seeds[view], self.differences.len());
        for k in 0..count {
            self.differences[k] = proposals.at(view, x, y, k)[0];
            self.confidences[k] = seed.confidence[proposals.proposer(x, y, k)];
            let inverse_depth = seed.planes[(x, y)][0] + self.differences[k] * seed.step;
            self.said[k] = cross_view.of(view, x, y, inverse_depth);
        }
        // Proposals within about a step of one speak for it, as sure as they are.
        self.supports.fill(0.0);
        for (difference, confidence) in self.differences.iter().zip(&self.confidences) {
            for (support, of) in self.supports.iter_mut().zip(&self.differences) {
                *support += confidence / (1.0 + (difference - of).powi(2));
            }
        }
        self.supports.iter_mut().for_each(|support| *support /= count as f32);
    }

    fn write(&self, likenesses: &[[f32; LIKENESS]], known: &mut [[f32; KNOWN]]) {
        for (k, known) in known.iter_mut().enumerate() {
            let difference = soft(self.differences[k]);
            let own = if k == 0 { 1.0 } else { 0.0 };
            let ([confirmed, front, behind], [colour, edge]) = (self.said[k], likenesses[k]);
            let (confidence, support) = (self.confidences[k], self.supports[k]);
            *known = [difference, difference.abs(), confidence, support, own, confirmed, front, behind, colour, edge];
        }
    }
}

/// Means over blocks of a value of every pixel, `[rows, columns]`.
fn block_means(proposals: &Proposals, value: impl Fn(usize, usize) -> f32) -> Vec<f32> {
    let Proposals { width, height, stride, .. } = *proposals;
    let (columns, rows) = proposals.weight_size();
    let share = 1.0 / (stride * stride) as f32;
    let mut means = vec![0.0f32; columns * rows];
    for y in 0..height {
        let means = &mut means[y / stride * columns..][..columns];
        (0..width).for_each(|x| means[x / stride] += share * value(x, y));
    }
    means
}
