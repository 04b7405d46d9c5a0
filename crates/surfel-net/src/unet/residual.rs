//! The residual block of the U-Net, the identity (or its 1x1 skip) until trained.

use crate::layers::{Conv2d, conv1x1, conv3x3, group_norm, zero_group_norm};
use crate::ops::{Activation, group_norm as normed};
use burn::module::Module;
use burn::nn::GroupNorm;
use burn::tensor::{Device, Tensor};

#[derive(Module, Debug)]
pub(super) struct ResidualBlock {
    first: Conv2d,
    first_norm: GroupNorm,
    second: Conv2d,
    second_norm: GroupNorm,
    skip: Option<Conv2d>,
}

impl ResidualBlock {
    pub(super) fn new(inputs: usize, outputs: usize, device: &Device) -> Self {
        Self {
            first: conv3x3(inputs, outputs, device),
            first_norm: group_norm(outputs, 8, device),
            second: conv3x3(outputs, outputs, device),
            second_norm: zero_group_norm(outputs, device),
            skip: (inputs != outputs).then(|| conv1x1(inputs, outputs, device)),
        }
    }

    pub(super) fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let y = normed(&self.first_norm, self.first.forward(x.clone()), Activation::Silu, None);
        let skip = match &self.skip {
            Some(skip) => skip.forward(x),
            None => x,
        };
        normed(&self.second_norm, self.second.forward(y), Activation::Silu, Some(skip))
    }
}
