//! How a seeded network chose among the planes proposed to a block, open to whoever teaches it to choose.
//!
//! Beside the depth that follows from the choice. Invariant: scores and proposals stand in the same order, the
//! pixel's own plane first, and only the scores carry a gradient.

use super::seed_maps::SeedMaps;
use crate::ops::propagate::Proposals;
use burn::tensor::{Tensor, TensorData};
use std::sync::Arc;

/// The choice at every block of `stride` x `stride` pixels of the padded photographs.
#[derive(Clone, Debug)]
pub struct Choice {
    /// Before the softmax over the proposals, `[views, proposals, rows, columns]`.
    pub scores: Tensor<4>,
    /// Pixels that share a choice, along each axis.
    pub stride: usize,
    proposals: Arc<Proposals>,
    step_of_view: Vec<f32>,
}

impl Choice {
    pub(super) fn new(scores: Tensor<4>, seeds: &SeedMaps) -> Self {
        let proposals = seeds.proposals.clone();
        Self { scores, stride: proposals.stride, proposals, step_of_view: seeds.step_of_view.clone() }
    }

    /// Inverse depth, 1 / scene unit, that each plane gives the first pixel of each block; as `scores`.
    pub fn proposed(&self) -> Tensor<4> {
        let [views, count, rows, columns] = self.scores.dims();
        let Proposals { width, height, stride, ref planes, .. } = *self.proposals;
        let mut proposed = Vec::with_capacity(views * count * rows * columns);
        for (view, step) in self.step_of_view.iter().enumerate() {
            for k in 0..count {
                for block in 0..rows * columns {
                    let (x, y) = (block % columns * stride, block / columns * stride);
                    let own = planes[(view * height + y) * width + x][0];
                    proposed.push(step * (own + self.proposals.at(view, x, y, k)[0]));
                }
            }
        }
        Tensor::from_data(TensorData::new(proposed, [views, count, rows, columns]), &self.scores.device())
    }
}
