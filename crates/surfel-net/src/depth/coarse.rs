//! Cost volume to relative disparity at stride 4 (spec 2.4.2, 2.4.3).
//!
//! Invariant: the disparity is the mean of the candidates under a distribution, so it lies in \[0, 1\].

use crate::config::CostVolumeConfig;
use crate::layers::{Conv2d, conv1x1, conv3x3, group_norm};
use crate::ops::{Activation, gelu, group_norm as normed};
use crate::unet::Unet;
use burn::module::Module;
use burn::nn::GroupNorm;
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Int, Tensor};

/// Regularises the correlation volume and reads depth from it.
#[derive(Module, Debug)]
pub(crate) struct CoarseDepth {
    enter: Conv2d,
    enter_norm: GroupNorm,
    unet: Unet,
    leave: Conv2d,
    residual: Conv2d,
    head: [Conv2d; 2],
}

impl CoarseDepth {
    pub(crate) fn new(channels: usize, config: &CostVolumeConfig, device: &Device) -> Self {
        let (candidates, width) = (config.num_candidates, config.unet.channels);
        Self {
            enter: conv3x3(candidates + channels, width, device),
            enter_norm: group_norm(width, 8, device),
            unet: Unet::new(&config.unet, device),
            leave: conv3x3(width, candidates, device),
            residual: conv1x1(candidates + channels, candidates, device),
            head: [conv3x3(candidates, 2 * candidates, device), conv3x3(2 * candidates, candidates, device)],
        }
    }

    /// Relative disparity and confidence, both `[views, 1, h, w]`, from correlations `[views, candidates, h, w]`.
    pub(crate) fn forward(
        &self,
        correlation: Tensor<4>,
        features: Tensor<4>,
        sources: &Tensor<2, Int>,
    ) -> (Tensor<4>, Tensor<4>) {
        let x = Tensor::cat(vec![correlation, features], 1);
        let y = normed(&self.enter_norm, self.enter.forward(x.clone()), Activation::Gelu, None);
        let refined = self.leave.forward(self.unet.forward(y, sources)) + self.residual.forward(x);
        let [first, second] = &self.head;
        let distribution = softmax(second.forward(gelu(first.forward(refined))), 1);
        let [_, candidates, _, _] = distribution.dims();
        let positions = Tensor::<1, Int>::arange(0..candidates as i64, &distribution.device()).float();
        let positions = (positions / (candidates - 1) as f32).reshape([1, candidates, 1, 1]);
        let disparity = (distribution.clone() * positions).sum_dim(1);
        (disparity, distribution.max_dim(1))
    }
}
