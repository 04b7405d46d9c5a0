//! Attention of every pixel of a view to all pixels of the view and its neighbours, at low resolution.
//!
//! Invariant: the identity until trained.

use crate::layers::{Conv2d, conv1x1, zero_group_norm};
use crate::ops::{Activation, attention, group_norm as normed};
use burn::module::Module;
use burn::nn::GroupNorm;
use burn::tensor::{Device, Int, Tensor};

/// Channels per head.
const HEAD: usize = 32;

#[derive(Module, Debug)]
pub(crate) struct ViewAttention {
    /// Queries, keys and values: per head, one after the other.
    project: Conv2d,
    merge: Conv2d,
    norm: GroupNorm,
}

impl ViewAttention {
    pub(crate) fn new(channels: usize, device: &Device) -> Self {
        Self {
            project: conv1x1(channels, 3 * channels, device),
            merge: conv1x1(channels, channels, device),
            norm: zero_group_norm(channels, device),
        }
    }

    pub(crate) fn forward(&self, x: Tensor<4>, sources: &Tensor<2, Int>) -> Tensor<4> {
        let [views, channels, height, width] = x.dims();
        let (heads, tokens) = ((channels / HEAD).max(1), height * width);
        let dim = channels / heads;
        let num_sources = sources.dims()[1];
        let all: Tensor<5> = self.project.forward(x.clone()).reshape([views, heads, 3, dim, tokens]);
        let part = |i: usize| -> Tensor<4> {
            all.clone().narrow(2, i, 1).reshape([views, heads, dim, tokens]).swap_dims(2, 3)
        };
        let gathered = |map: Tensor<4>| -> Tensor<4> {
            let all = map.select(0, sources.clone().reshape([views * num_sources]));
            let all: Tensor<5> = all.reshape([views, num_sources, heads, tokens, dim]);
            all.permute([0, 2, 1, 3, 4]).reshape([views, heads, num_sources * tokens, dim])
        };
        let (query, key, value) = (part(0), gathered(part(1)), gathered(part(2)));
        let y = attention(query, key, value, None);
        let y = y.swap_dims(2, 3).reshape([views, channels, height, width]);
        normed(&self.norm, self.merge.forward(y), Activation::Identity, Some(x))
    }
}
