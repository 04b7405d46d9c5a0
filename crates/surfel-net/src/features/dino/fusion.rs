//! DINO features added to the backbone's (spec 1.10, row 3).
//!
//! Invariant: until trained it returns the backbone's features, because its last layer starts at zero, so it may be
//! bolted onto trained weights.

use super::resample::{linear, resampled};
use crate::layers::{Conv2d, conv_config, conv1x1};
use burn::module::Module;
use burn::nn::Initializer;
use burn::tensor::{Device, Tensor};

/// Input pixels per pixel of the backbone's features.
const STRIDE: usize = 4;

/// The trained layers between both.
#[derive(Module, Debug)]
pub(crate) struct DinoFusion {
    project: Conv2d,
    join: Conv2d,
}

impl DinoFusion {
    /// From features of `width` channels to the backbone's `channels`.
    pub(crate) fn new(width: usize, channels: usize, device: &Device) -> Self {
        Self {
            project: conv1x1(width, channels, device),
            join: conv_config(channels, channels, 3).with_initializer(Initializer::Zeros).init(device),
        }
    }

    /// `context` `[views, channels, height, width]`, whose pixel `i` stands over input pixel `4 i`, with the features
    /// of patches `[views, width, rows, columns]` of the same images added.
    pub(crate) fn forward(&self, context: Tensor<4>, patches: Tensor<4>) -> Tensor<4> {
        let ([_, _, height, width], [_, _, rows, columns]) = (context.dims(), patches.dims());
        let placed = |outputs: usize, patches: usize| {
            // The centre of input pixel `4 i`, as a share of the side, in patches.
            let share = move |i: usize| ((STRIDE * i) as f64 + 0.5) / (STRIDE * outputs) as f64;
            linear((0..outputs).map(move |i| share(i) * patches as f64 - 0.5), patches)
        };
        let projected = self.project.forward(patches);
        context + self.join.forward(resampled(projected, &placed(height, rows), &placed(width, columns)))
    }
}
