//! The few layers whose settings every part of the network shares.
//!
//! Invariant: what they are made of follows from their arguments alone; only weights are drawn.

mod conv;
mod linear;
mod upsample;
mod values;

pub(crate) use conv::{Conv2d, ConvConfig};
pub(crate) use linear::Linear;
pub(crate) use upsample::{nearest, upsample};
pub use values::values;

use burn::nn::{GroupNorm, GroupNormConfig, Initializer};
use burn::tensor::{Device, Tensor};

/// Settings of a convolution that keeps the size at stride 1.
pub(crate) fn conv_config(inputs: usize, outputs: usize, kernel: usize) -> ConvConfig {
    ConvConfig::new(inputs, outputs, kernel)
}

/// 3x3 convolution with bias.
pub(crate) fn conv3x3(inputs: usize, outputs: usize, device: &Device) -> Conv2d {
    conv_config(inputs, outputs, 3).init(device)
}

/// 1x1 convolution with bias.
pub(crate) fn conv1x1(inputs: usize, outputs: usize, device: &Device) -> Conv2d {
    conv_config(inputs, outputs, 1).init(device)
}

/// Group normalisation with the wished number of groups, or 4 where the channels do not divide (spec 2.6).
pub(crate) fn group_norm(channels: usize, groups: usize, device: &Device) -> GroupNorm {
    let groups = if channels.is_multiple_of(groups) { groups } else { 4 };
    GroupNormConfig::new(groups, channels).init(device)
}

/// A group normalisation that outputs zero until trained.
pub(crate) fn zero_group_norm(channels: usize, device: &Device) -> GroupNorm {
    let mut norm = group_norm(channels, 8, device);
    norm.gamma = Some(Initializer::Zeros.init([channels], device));
    norm
}

/// Every `factor` x `factor` block of pixels as the channels of one pixel.
pub(crate) fn space_to_depth(map: Tensor<4>, factor: usize) -> Tensor<4> {
    let [views, channels, height, width] = map.dims();
    let (h, w) = (height / factor, width / factor);
    let blocks: Tensor<6> = map.reshape([views, channels, h, factor, w, factor]).permute([0, 1, 3, 5, 2, 4]);
    blocks.reshape([views, channels * factor * factor, h, w])
}

/// The inverse of [`space_to_depth`].
pub(crate) fn depth_to_space(map: Tensor<4>, factor: usize) -> Tensor<4> {
    let [views, channels, height, width] = map.dims();
    let outputs = channels / (factor * factor);
    let blocks: Tensor<6> = map.reshape([views, outputs, factor, factor, height, width]).permute([0, 1, 4, 2, 5, 3]);
    blocks.reshape([views, outputs, height * factor, width * factor])
}
