//! The residual CNN of the paper's backbone (spec 2.2): images to features at stride 4.
//!
//! Invariant: normalisation is per image, so a view's features do not depend on the other views.

use crate::layers::{Conv2d, conv_config, conv1x1};
use crate::ops::relu;
use burn::module::Module;
use burn::nn::{Initializer, InstanceNorm, InstanceNormConfig};
use burn::tensor::{Device, Tensor};

/// ImageNet statistics of sRGB in \[0, 1\].
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const STD: [f32; 3] = [0.229, 0.224, 0.225];

fn bare_conv(inputs: usize, outputs: usize, kernel: usize, stride: usize, device: &Device) -> Conv2d {
    let initializer = Initializer::KaimingNormal { gain: std::f64::consts::SQRT_2, fan_out_only: true };
    conv_config(inputs, outputs, kernel).with_stride(stride).with_bias(false).with_initializer(initializer).init(device)
}

fn norm(channels: usize, device: &Device) -> InstanceNorm {
    InstanceNormConfig::new(channels).with_affine(false).init(device)
}

/// Two normalised convolutions around a skip.
#[derive(Module, Debug)]
struct ResidualBlock {
    first: Conv2d,
    second: Conv2d,
    norms: [InstanceNorm; 2],
    skip: Option<Conv2d>,
}

impl ResidualBlock {
    fn new(inputs: usize, outputs: usize, stride: usize, device: &Device) -> Self {
        let skip = (stride != 1 || inputs != outputs)
            .then(|| conv_config(inputs, outputs, 1).with_stride(stride).init(device));
        Self {
            first: bare_conv(inputs, outputs, 3, stride, device),
            second: bare_conv(outputs, outputs, 3, 1, device),
            norms: [norm(outputs, device), norm(outputs, device)],
            skip,
        }
    }

    fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let [first, second] = &self.norms;
        let y = relu(first.forward(self.first.forward(x.clone())));
        let y = relu(second.forward(self.second.forward(y)));
        let skip = match &self.skip {
            Some(conv) => first.forward(conv.forward(x)),
            None => x,
        };
        relu(skip + y)
    }
}

/// The backbone.
#[derive(Module, Debug)]
pub(crate) struct Cnn {
    stem: Conv2d,
    stem_norm: InstanceNorm,
    blocks: Vec<ResidualBlock>,
    project: Conv2d,
}

impl Cnn {
    pub(crate) fn new(widths: [usize; 2], channels: usize, device: &Device) -> Self {
        let [stem, middle] = widths;
        let steps = [(stem, stem, 1), (stem, stem, 1), (stem, middle, 2), (middle, middle, 1), (middle, channels, 1)];
        let steps = steps.into_iter().chain([(channels, channels, 1)]);
        Self {
            stem: bare_conv(3, stem, 7, 2, device),
            stem_norm: norm(stem, device),
            blocks: steps.map(|(i, o, stride)| ResidualBlock::new(i, o, stride, device)).collect(),
            project: conv1x1(channels, channels, device),
        }
    }

    /// Features `[views, channels, height / 4, width / 4]` of sRGB images `[views, 3, height, width]` in \[0, 1\].
    pub(crate) fn forward(&self, images: Tensor<4>) -> Tensor<4> {
        let device = images.device();
        let statistic = |values: [f32; 3]| Tensor::<1>::from_floats(values, &device).reshape([1, 3, 1, 1]);
        let x = (images - statistic(MEAN)) / statistic(STD);
        let x = relu(self.stem_norm.forward(self.stem.forward(x)));
        self.project.forward(self.blocks.iter().fold(x, |x, block| block.forward(x)))
    }
}
