//! The attribute head (spec 2.7.1): two convolutions from features to raw scales, rotation and colour.
//!
//! Output channels: 2 scales, 4 of the quaternion w x y z, then SH coefficients of red, green and blue.
//! Invariant: a fresh head predicts discs about facing their camera, a neutral start for every pixel; in a seeded
//! network exactly those, so that fresh surfels lie in matching's surface.

use crate::config::HeadConfig;
use crate::layers::{Conv2d, conv3x3};
use crate::ops::gelu;
use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use surfel_core::sh;

/// Channels before the SH coefficients.
pub(super) const NUM_SHAPE: usize = 6;
/// Footprint of a neutral surfel, pixels (spec 1.7): neighbours overlap without blurring each other.
const FRESH_PX: f64 = 0.6;
/// Gain of a neutral head: an optimiser's step must not overthrow a surface.
const NEUTRAL_GAIN: f64 = 0.1;
/// Channel of the quaternion's real part.
const REAL_PART: usize = 2;

/// The head.
#[derive(Module, Debug)]
pub(crate) struct AttributeHead {
    first: Conv2d,
    second: Conv2d,
    /// Added to the output: what a fresh head predicts.
    #[module(skip)]
    start: Vec<f32>,
    #[module(skip)]
    gain: f64,
}

impl AttributeHead {
    pub(crate) fn new(feature_channels: usize, config: &HeadConfig, neutral: bool, device: &Device) -> Self {
        let outputs = NUM_SHAPE + 3 * sh::num_coefficients(config.sh_degree);
        let hidden = config.hidden_channels.unwrap_or(2 * outputs);
        let mut second = conv3x3(hidden, outputs, device);
        let mut start = vec![0.0f32; outputs];
        start[REAL_PART] = 1.0;
        if neutral {
            second.weight = Param::from_tensor(second.weight.val().zeros_like());
            let share = (FRESH_PX / 0.2 - config.scale_min) / (config.scale_max - config.scale_min);
            let share = share.clamp(0.01, 0.99);
            start[..2].fill((share / (1.0 - share)).ln() as f32);
        }
        // A neutral head keeps its start beside its weights, so that the gain does not touch it.
        let zeros = vec![0.0f32; outputs];
        let (bias, start, gain) = if neutral { (zeros, start, NEUTRAL_GAIN) } else { (start, zeros, 1.0) };
        second.bias = Some(Param::from_tensor(Tensor::from_floats(bias.as_slice(), device)));
        Self { first: conv3x3(feature_channels, hidden, device), second, start, gain }
    }

    /// Raw attributes `[views, outputs, height, width]`.
    pub(crate) fn forward(&self, features: Tensor<4>) -> Tensor<4> {
        let raw = self.second.forward(gelu(self.first.forward(features)));
        let start = Tensor::<1>::from_floats(self.start.as_slice(), &raw.device());
        raw * self.gain + start.reshape([1, self.start.len(), 1, 1])
    }
}
