//! Cross-view feature aggregation (spec 2.7.4): each surfel's feature asks the pixels that see it.
//!
//! Invariant: until trained it returns its input (the last linear maps start at zero), so the refined
//! surfels start as the initial ones.

use crate::config::AggregationConfig;
use crate::layers::Linear;
use crate::ops::gather_attention::Regions;
use crate::ops::{gather_attention, gelu};
use burn::module::Module;
use burn::nn::{LayerNorm, LayerNormConfig};
use burn::tensor::{Device, Tensor};
use std::sync::Arc;

/// Attention over footprint regions and a feed-forward part, both residual.
#[derive(Module, Debug)]
pub(crate) struct Aggregation {
    query_norm: LayerNorm,
    query: Linear,
    memory_norm: LayerNorm,
    key: Linear,
    value: Linear,
    merge: Linear,
    feed_norm: LayerNorm,
    widen: Linear,
    narrow: Linear,
    num_heads: usize,
}

impl Aggregation {
    pub(crate) fn new(feature_channels: usize, config: &AggregationConfig, device: &Device) -> Self {
        let linear = |inputs, outputs| Linear::new(inputs, outputs, device);
        let zero = |inputs, outputs| Linear::zeros(inputs, outputs, device);
        let norm = || LayerNormConfig::new(feature_channels).init(device);
        let hidden = feature_channels * config.expansion;
        Self {
            query_norm: norm(),
            query: linear(feature_channels, config.channels),
            memory_norm: norm(),
            key: linear(feature_channels, config.channels),
            value: linear(feature_channels, config.channels),
            merge: zero(config.channels, feature_channels),
            feed_norm: norm(),
            widen: linear(feature_channels, hidden),
            narrow: zero(hidden, feature_channels),
            num_heads: config.num_heads,
        }
    }

    /// Refined features of the same shape `[views, channels, height, width]`.
    pub(crate) fn forward(&self, features: Tensor<4>, regions: Arc<Regions>) -> Tensor<4> {
        let [views, channels, height, width] = features.dims();
        let x: Tensor<2> = features.permute([0, 2, 3, 1]).reshape([views * height * width, channels]);
        let query = self.query.forward(self.query_norm.forward(x.clone()));
        let memory = self.memory_norm.forward(x.clone());
        let (key, value) = (self.key.forward(memory.clone()), self.value.forward(memory));
        let attended = gather_attention(query, key, value, self.num_heads, regions);
        let x = x + self.merge.forward(attended);
        let fed = self.narrow.forward(gelu(self.widen.forward(self.feed_norm.forward(x.clone()))));
        (x + fed).reshape([views, height, width, channels]).permute([0, 3, 1, 2])
    }
}
