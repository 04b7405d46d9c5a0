//! The linear layer: burn's parameters, names and initialisation, and a count of what it multiplies.
//!
//! Invariant: a checkpoint of a network with burn's `Linear` in the same place fits.

use crate::ops::count;
use burn::module::{Module, Param};
use burn::nn::{Initializer, LinearConfig};
use burn::tensor::module::linear;
use burn::tensor::{Device, Tensor};

/// A linear map of the last axis.
#[derive(Module, Debug)]
pub(crate) struct Linear {
    /// `[inputs, outputs]`.
    weight: Param<Tensor<2>>,
    /// `[outputs]`.
    bias: Option<Param<Tensor<1>>>,
}

impl Linear {
    /// As the settings say.
    pub(crate) fn init(config: LinearConfig, device: &Device) -> Self {
        let burn = config.init(device);
        Self { weight: burn.weight, bias: burn.bias }
    }

    /// With bias, drawn as burn does.
    pub(crate) fn new(inputs: usize, outputs: usize, device: &Device) -> Self {
        Self::init(LinearConfig::new(inputs, outputs), device)
    }

    /// With bias, zero until trained.
    pub(crate) fn zeros(inputs: usize, outputs: usize, device: &Device) -> Self {
        Self::init(LinearConfig::new(inputs, outputs).with_initializer(Initializer::Zeros), device)
    }

    /// `[..., inputs]` to `[..., outputs]`.
    pub(crate) fn forward<const D: usize>(&self, x: Tensor<D>) -> Tensor<D> {
        let [inputs, outputs] = self.weight.dims();
        count::tell_product(&[x.shape().num_elements() / inputs.max(1), inputs, outputs]);
        linear(x, self.weight.val(), self.bias.as_ref().map(|bias| bias.val()))
    }
}
