//! Plane propagation as a kernel that burn differentiates through.
//!
//! Invariant: no gradient flows to the proposing planes.

use crate::ops::kernel::{Kernel, SLOTS, run};
use crate::ops::propagate::{self, Proposals};
use burn::tensor::Tensor;
use std::sync::Arc;

/// Scores `[views, proposals, height / stride, width / stride]` are the only input.
impl Kernel for Arc<Proposals> {
    fn shape(&self) -> Vec<usize> {
        vec![self.num_views(), 3, self.height, self.width]
    }

    fn forward(&self, inputs: &[&[f32]; SLOTS]) -> Vec<f32> {
        propagate::forward(inputs[0], self)
    }

    fn backward(&self, inputs: &[&[f32]; SLOTS], grad: &[f32], _: [bool; SLOTS]) -> [Option<Vec<f32>>; SLOTS] {
        [Some(propagate::backward(inputs[0], self, grad)), None, None, None, None]
    }
}

/// Planes `[views, 3, height, width]` of scores `[views, proposals, height / stride, width / stride]`.
pub fn propagate_planes(scores: Tensor<4>, proposals: Arc<Proposals>) -> Tensor<4> {
    let device = scores.device();
    run(&device, [scores.into_dispatch()], proposals)
}
