//! Plane propagation as a kernel that burn differentiates through.
//!
//! Invariant: no gradient flows to the proposing planes.

#[cfg(any(feature = "cuda", feature = "wgpu"))]
use crate::ops::card::{self, OnCard};
use crate::ops::kernel::{Kernel, SLOTS, run};
use crate::ops::propagate::{self, Proposals};
use burn::tensor::Tensor;
use std::sync::Arc;

/// Inputs are the scores and the leans.
impl Kernel for Arc<Proposals> {
    fn shape(&self) -> Vec<usize> {
        vec![self.num_views(), 3, self.height, self.width]
    }

    fn forward(&self, inputs: &[&[f32]; SLOTS]) -> Vec<f32> {
        let [scores, leans, ..] = *inputs;
        propagate::forward(scores, leans, self)
    }

    fn backward(&self, inputs: &[&[f32]; SLOTS], grad: &[f32], _: [bool; SLOTS]) -> [Option<Vec<f32>>; SLOTS] {
        let [scores, leans, ..] = *inputs;
        let (of_scores, of_leans) = propagate::backward(scores, leans, self, grad);
        [Some(of_scores), Some(of_leans), None, None, None]
    }

    #[cfg(any(feature = "cuda", feature = "wgpu"))]
    fn on_card(&self, inputs: &[OnCard; SLOTS]) -> Option<OnCard> {
        Some(card::propagate(&inputs[0], &inputs[1], self))
    }

    #[cfg(any(feature = "cuda", feature = "wgpu"))]
    fn gradients_on_card(
        &self,
        inputs: &[OnCard; SLOTS],
        grad: &OnCard,
        _: [bool; SLOTS],
    ) -> Option<[Option<OnCard>; SLOTS]> {
        let [of_scores, of_leans] = card::propagate_gradients(&inputs[0], &inputs[1], self, grad);
        Some([Some(of_scores), Some(of_leans), None, None, None])
    }
}

/// Planes `[views, 3, height, width]` of scores `[views, proposals, height / stride, width / stride]` and leans
/// `[views, 1, height, width]`.
pub fn propagate_planes(scores: Tensor<4>, leans: Tensor<4>, proposals: Arc<Proposals>) -> Tensor<4> {
    let device = scores.device();
    run(&device, [scores.into_dispatch(), leans.into_dispatch()], proposals)
}
