//! How a seeded network chose among the planes proposed to a block, open to whoever teaches it to choose.
//!
//! Beside the depth that follows from the choice. The pixels of a block choose each for themselves; one of them is
//! judged, another from block to block, so that all are. Invariant: scores and proposals stand in the same order, the
//! pixel's own plane first, and only scores and leans carry a gradient.

use super::seed_maps::SeedMaps;
use crate::layers::space_to_depth;
use crate::ops::propagate::{Proposals, soft};
use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;
use std::sync::Arc;

/// The choice at every block of `stride` x `stride` pixels of the padded photographs.
#[derive(Clone, Debug)]
pub struct Choice {
    /// `[views, proposals, rows, columns]`.
    scores: Tensor<4>,
    /// `[views, 1, height, width]`.
    leans: Tensor<4>,
    proposals: Arc<Proposals>,
    step_of_view: Vec<f32>,
}

impl Choice {
    pub(super) fn new(scores: Tensor<4>, leans: Tensor<4>, seeds: &SeedMaps) -> Self {
        Self { scores, leans, proposals: seeds.proposals.clone(), step_of_view: seeds.step_of_view.clone() }
    }

    /// Pixels of a block, along each axis.
    pub fn stride(&self) -> usize {
        self.proposals.stride
    }

    /// The pixel, column and row, at which a block is judged.
    pub fn judged_pixel(&self, column: usize, row: usize) -> (usize, usize) {
        let stride = self.stride();
        let within = self.judged_within(column, row);
        (column * stride + within % stride, row * stride + within / stride)
    }

    /// Its number within the block.
    fn judged_within(&self, column: usize, row: usize) -> usize {
        let pixels = self.stride() * self.stride();
        (column + row * (pixels - 1)) % pixels
    }

    /// Scores before the softmax over the proposals, at the judged pixels, `[views, proposals, rows, columns]`.
    pub fn judged_scores(&self) -> Tensor<4> {
        let ([_, _, rows, columns], stride) = (self.scores.dims(), self.stride());
        let device = self.scores.device();
        let is_judged = |i: usize| {
            let (within, block) = (i / (rows * columns), i % (rows * columns));
            f32::from(u8::from(within == self.judged_within(block % columns, block / columns)))
        };
        let judged: Vec<f32> = (0..stride * stride * rows * columns).map(is_judged).collect();
        let judged: Tensor<4> =
            Tensor::from_data(TensorData::new(judged, [1, stride * stride, rows, columns]), &device);
        let leans = (space_to_depth(self.leans.clone(), stride) * judged).sum_dim(1);
        self.scores.clone() + leans * self.of_proposals(|_, _, relative| soft(relative))
    }

    /// Inverse depth, 1 / scene unit, that each plane gives the judged pixels; as [`Self::judged_scores`].
    pub fn proposed(&self) -> Tensor<4> {
        self.of_proposals(|step, own, relative| step * (own + relative))
    }

    /// A value of the step of the view, the pixel's own inverse depth and that of the proposal relative to it, steps.
    fn of_proposals(&self, value: impl Fn(f32, f32, f32) -> f32 + Sync) -> Tensor<4> {
        let [views, count, rows, columns] = self.scores.dims();
        let mut values = vec![0.0; views * count * rows * columns];
        values.par_chunks_mut(rows * columns).enumerate().for_each(|(i, values)| {
            let (view, k) = (i / count, i % count);
            for (block, to) in values.iter_mut().enumerate() {
                let (x, y) = self.judged_pixel(block % columns, block / columns);
                let own = self.proposals.own(view, x, y)[0];
                *to = value(self.step_of_view[view], own, self.proposals.at(view, x, y, k)[0]);
            }
        });
        Tensor::from_data(TensorData::new(values, [views, count, rows, columns]), &self.scores.device())
    }
}
