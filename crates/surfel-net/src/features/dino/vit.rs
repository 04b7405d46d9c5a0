//! The vision transformer of DINOv2 (spec 2.5): patches of an image to features.
//!
//! Pre-norm blocks with a learned scale on both branches, learned positions that are interpolated to other sizes, no
//! register tokens. Invariant: it is a function of one image alone.

use super::resample::{cubic, resampled};
use super::{DinoModel, PATCH, Sizes};
use crate::layers::Linear;
use crate::ops::{attention, gelu};
use burn::module::{Module, Param};
use burn::nn::{Initializer, LayerNorm, LayerNormConfig};
use burn::tensor::{Device, Tensor};

/// Of every layer normalisation.
const EPSILON: f64 = 1e-6;
/// Hidden width of the feed-forward part over its input width.
const EXPANSION: usize = 4;
/// By how much of a patch the published models stretch positions when they interpolate them.
const STRETCH: f64 = 0.1;

/// Zeros, until a file is loaded: drawing weights would be in vain and disturb the draws of others.
fn zeros<const D: usize>(shape: [usize; D], device: &Device) -> Param<Tensor<D>> {
    Initializer::Zeros.init(shape, device)
}

fn dense(inputs: usize, outputs: usize, device: &Device) -> Linear {
    Linear::zeros(inputs, outputs, device)
}

fn norm(width: usize, device: &Device) -> LayerNorm {
    LayerNormConfig::new(width).with_epsilon(EPSILON).init(device)
}

/// Attention, then a feed-forward part, both scaled and residual.
#[derive(Module, Debug)]
struct Block {
    attention_norm: LayerNorm,
    qkv: Linear,
    merge: Linear,
    attention_gamma: Param<Tensor<1>>,
    feed_norm: LayerNorm,
    widen: Linear,
    narrow: Linear,
    feed_gamma: Param<Tensor<1>>,
    num_heads: usize,
}

impl Block {
    fn new(width: usize, num_heads: usize, device: &Device) -> Self {
        Self {
            attention_norm: norm(width, device),
            qkv: dense(width, 3 * width, device),
            merge: dense(width, width, device),
            attention_gamma: zeros([width], device),
            feed_norm: norm(width, device),
            widen: dense(width, EXPANSION * width, device),
            narrow: dense(EXPANSION * width, width, device),
            feed_gamma: zeros([width], device),
            num_heads,
        }
    }

    /// Tokens `[images, tokens, width]` to the same shape.
    fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let [images, tokens, width] = x.dims();
        let (heads, dim) = (self.num_heads, width / self.num_heads);
        let qkv: Tensor<5> =
            self.qkv.forward(self.attention_norm.forward(x.clone())).reshape([images, tokens, 3, heads, dim]);
        let qkv = qkv.permute([2, 0, 3, 1, 4]);
        let [query, key, value] = [0, 1, 2].map(|i| qkv.clone().narrow(0, i, 1).reshape([images, heads, tokens, dim]));
        let y = attention(query, key, value, None);
        let y = self.merge.forward(y.permute([0, 2, 1, 3]).reshape([images, tokens, width]));
        let x = x + y * self.attention_gamma.val().reshape([1, 1, width]);
        let y = self.narrow.forward(gelu(self.widen.forward(self.feed_norm.forward(x.clone()))));
        x + y * self.feed_gamma.val().reshape([1, 1, width])
    }
}

/// The transformer.
#[derive(Module, Debug)]
pub(crate) struct Vit {
    /// `[width]`.
    class_token: Param<Tensor<1>>,
    /// Of the class token, then of the patches row by row, `[1 + grid * grid, width]`.
    positions: Param<Tensor<2>>,
    /// A patch's values, channel by channel, to a token.
    patches: Linear,
    blocks: Vec<Block>,
    norm: LayerNorm,
    grid: usize,
}

impl Vit {
    /// All zeros.
    pub(crate) fn new(model: DinoModel, device: &Device) -> Self {
        let Sizes { width, depth, num_heads, grid } = model.sizes();
        Self {
            class_token: zeros([width], device),
            positions: zeros([1 + grid * grid, width], device),
            patches: dense(3 * PATCH * PATCH, width, device),
            blocks: (0..depth).map(|_| Block::new(width, num_heads, device)).collect(),
            norm: norm(width, device),
            grid,
        }
    }

    /// Features of patches `[images, width, rows, columns]` of normalised images `[images, 3, 14 rows, 14 columns]`.
    pub(crate) fn forward(&self, images: Tensor<4>) -> Tensor<4> {
        let [num_images, _, height, width] = images.dims();
        let (rows, columns) = (height / PATCH, width / PATCH);
        let patches: Tensor<6> = images.reshape([num_images, 3, rows, PATCH, columns, PATCH]);
        let patches: Tensor<3> =
            patches.permute([0, 2, 4, 1, 3, 5]).reshape([num_images, rows * columns, 3 * PATCH * PATCH]);
        let x = self.patches.forward(patches) + self.positions_of(rows, columns);
        let [_, _, channels] = x.dims();
        let class = self.class_token.val().reshape([1, channels]) + self.positions.val().narrow(0, 0, 1);
        let class: Tensor<3> = class.unsqueeze_dim(0);
        let x = Tensor::cat(vec![class.repeat_dim(0, num_images), x], 1);
        let x = self.norm.forward(self.blocks.iter().fold(x, |x, block| block.forward(x)));
        x.narrow(1, 1, rows * columns).reshape([num_images, rows, columns, channels]).permute([0, 3, 1, 2])
    }

    /// Of the patches, `[1, rows * columns, width]`.
    fn positions_of(&self, rows: usize, columns: usize) -> Tensor<3> {
        let grid = self.grid;
        let patches = self.positions.val().narrow(0, 1, grid * grid);
        let [_, width] = patches.dims();
        if (rows, columns) == (grid, grid) {
            return patches.unsqueeze_dim(0);
        }
        let stretched = |outputs: usize| {
            let step = grid as f64 / (outputs as f64 + STRETCH);
            cubic((0..outputs).map(move |i| (i as f64 + 0.5) * step - 0.5), grid)
        };
        let map = patches.reshape([1, grid, grid, width]).permute([0, 3, 1, 2]);
        let map = resampled(map, &stretched(rows), &stretched(columns));
        map.permute([0, 2, 3, 1]).reshape([1, rows * columns, width])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Spec 2.10, without the token that only pretraining uses.
    #[test]
    fn the_published_models_have_their_parameters() {
        for (model, expected) in [(DinoModel::VitS14, 22_056_576), (DinoModel::VitL14, 304_368_640)] {
            let vit = Vit::new(model, &Device::flex());
            assert_eq!(vit.num_params(), expected - model.width(), "{model}");
        }
    }
}
