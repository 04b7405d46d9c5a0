//! The convolution layer: burn's parameters, names and initialisation around our own kernels.
//!
//! Invariant: a checkpoint of a network with burn's `Conv2d` in the same place fits.

use crate::ops::conv2d;
use burn::module::{Module, Param};
use burn::nn::Initializer;
use burn::nn::conv::Conv2dConfig;
use burn::tensor::{Device, Tensor};

/// A convolution with a square kernel and zeros around the map.
#[derive(Module, Debug)]
pub(crate) struct Conv2d {
    /// `[outputs, inputs, kernel, kernel]`.
    pub(crate) weight: Param<Tensor<4>>,
    /// `[outputs]`.
    pub(crate) bias: Option<Param<Tensor<1>>>,
    stride: usize,
    padding: usize,
}

impl Conv2d {
    /// `[images, inputs, height, width]` to `[images, outputs, ceil(height / stride), ceil(width / stride)]`.
    pub(crate) fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let bias = self.bias.as_ref().map(|bias| bias.val());
        conv2d(x, self.weight.val(), bias, self.stride, self.padding)
    }
}

/// Settings of a convolution.
pub(crate) struct ConvConfig {
    burn: Conv2dConfig,
}

impl ConvConfig {
    /// With bias, at stride 1, keeping the size of the map.
    pub(super) fn new(inputs: usize, outputs: usize, kernel: usize) -> Self {
        Self { burn: Conv2dConfig::new([inputs, outputs], [kernel, kernel]) }
    }

    /// Input pixels per output pixel.
    pub(crate) fn with_stride(self, stride: usize) -> Self {
        Self { burn: self.burn.with_stride([stride; 2]) }
    }

    pub(crate) fn with_bias(self, bias: bool) -> Self {
        Self { burn: self.burn.with_bias(bias) }
    }

    pub(crate) fn with_initializer(self, initializer: Initializer) -> Self {
        Self { burn: self.burn.with_initializer(initializer) }
    }

    pub(crate) fn init(self, device: &Device) -> Conv2d {
        let burn = self.burn.init(device);
        Conv2d { weight: burn.weight, bias: burn.bias, stride: burn.stride[0], padding: burn.kernel_size[0] / 2 }
    }
}
