//! The multi-view transformer (spec 2.3): features of each view, informed by its neighbours.
//!
//! Attention runs inside windows; every second layer shifts them by half a window. Invariant: the views are
//! treated alike, so renaming them renames the outputs.

mod layer;
mod position;
mod window;

use crate::config::TransformerConfig;
use burn::module::Module;
use burn::tensor::{Device, Int, Tensor};
use layer::Layer;
use window::Windows;

/// The layers.
#[derive(Module, Debug)]
pub(crate) struct Transformer {
    layers: Vec<Layer>,
    num_splits: usize,
}

impl Transformer {
    pub(crate) fn new(channels: usize, config: &TransformerConfig, device: &Device) -> Self {
        Self {
            layers: (0..config.num_layers).map(|_| Layer::new(channels, config.expansion, device)).collect(),
            num_splits: config.num_splits,
        }
    }

    /// `[views, channels, h, w]` to the same shape; `neighbours` is `[views, neighbours per view]`.
    pub(crate) fn forward(&self, features: Tensor<4>, neighbours: Tensor<2, Int>) -> Tensor<4> {
        let [_, channels, height, width] = features.dims();
        let device = features.device();
        let mut x = features.permute([0, 2, 3, 1]);
        let plain = Windows::new(width, height, self.num_splits, false);
        let shifted = Windows::new(width, height, self.num_splits, true);
        let encoding = position::encoding(plain.width, plain.height, channels, &device);
        x = x + encoding.repeat_dim(1, self.num_splits).repeat_dim(2, self.num_splits);
        for (i, layer) in self.layers.iter().enumerate() {
            x = layer.forward(x, &neighbours, if i % 2 == 1 { &shifted } else { &plain });
        }
        x.permute([0, 3, 1, 2])
    }
}
