//! One transformer layer: attention within the view, then to its neighbours, then a feed-forward part.
//!
//! The neighbours are read inside the same window or along epipolar lines. Invariant: cross-attention reads them as
//! they were when the layer began.

use super::along::LineAttention;
use super::window::Windows;
use crate::config::TransformerConfig;
use crate::layers::Linear;
use crate::ops::epipolar::EpipolarLines;
use crate::ops::{attention, gelu};
use burn::module::Module;
use burn::nn::{Initializer, LayerNorm, LayerNormConfig, LinearConfig};
use burn::tensor::{Device, Int, Tensor};
use std::sync::Arc;

pub(super) fn linear(inputs: usize, outputs: usize, device: &Device) -> Linear {
    let initializer = Initializer::XavierUniform { gain: 1.0 };
    Linear::init(LinearConfig::new(inputs, outputs).with_bias(false).with_initializer(initializer), device)
}

/// Single-head attention with projections and a normalised output.
#[derive(Module, Debug)]
struct Attention {
    query: Linear,
    key: Linear,
    value: Linear,
    merge: Linear,
    norm: LayerNorm,
}

impl Attention {
    fn new(channels: usize, device: &Device) -> Self {
        let project = || linear(channels, channels, device);
        let norm = LayerNormConfig::new(channels).init(device);
        Self { query: project(), key: project(), value: project(), merge: project(), norm }
    }

    /// `x` `[views, height, width, C]` attending within each window to the same window of `sources`
    /// `[views, sources per view]`, or to itself.
    fn forward(
        &self,
        x: Tensor<4>,
        memory: Tensor<4>,
        sources: Option<&Tensor<2, Int>>,
        windows: &Windows,
    ) -> Tensor<4> {
        let [views, _, _, channels] = x.dims();
        let device = x.device();
        let (count, len) = (windows.count(), windows.len());
        let num_sources = sources.map_or(1, |s| s.dims()[1]);
        let gathered = |map: Tensor<4>| -> Tensor<4> {
            let tokens = windows.split(map);
            let tokens = match sources {
                Some(sources) => {
                    let all = tokens.select(0, sources.clone().reshape([views * num_sources]));
                    let all: Tensor<5> = all.reshape([views, num_sources, count, len, channels]);
                    all.permute([0, 2, 1, 3, 4])
                }
                None => tokens.reshape([views, count, 1, len, channels]),
            };
            tokens.reshape([views * count, 1, num_sources * len, channels])
        };
        let query = windows.split(self.query.forward(x)).reshape([views * count, 1, len, channels]);
        let key = gathered(self.key.forward(memory.clone()));
        let value = gathered(self.value.forward(memory));
        let bias = windows.mask(&device).map(|mask| {
            let tiled: Tensor<4> = mask.repeat_dim(2, num_sources).repeat_dim(0, views).unsqueeze_dim(1);
            tiled
        });
        let y = attention(query, key, value, bias);
        let y = windows.merge(y.reshape([views, count, len, channels]));
        self.norm.forward(self.merge.forward(y))
    }
}

/// Self-attention, cross-attention, feed-forward.
#[derive(Module, Debug)]
pub(super) struct Layer {
    within: Attention,
    across: Option<Attention>,
    along: Option<LineAttention>,
    widen: Linear,
    narrow: Linear,
    norm: LayerNorm,
}

impl Layer {
    pub(super) fn new(channels: usize, config: &TransformerConfig, device: &Device) -> Self {
        let hidden = 2 * channels * config.expansion;
        Self {
            within: Attention::new(channels, device),
            across: config.epipolar.is_none().then(|| Attention::new(channels, device)),
            along: config.epipolar.as_ref().map(|config| LineAttention::new(channels, config, device)),
            widen: linear(2 * channels, hidden, device),
            narrow: linear(hidden, channels, device),
            norm: LayerNormConfig::new(channels).init(device),
        }
    }

    /// `lines` are there where the configuration asks for them.
    pub(super) fn forward(
        &self,
        x: Tensor<4>,
        neighbours: &Tensor<2, Int>,
        windows: &Windows,
        lines: Option<&Arc<EpipolarLines>>,
    ) -> Tensor<4> {
        let before = x.clone();
        let x = x.clone() + self.within.forward(x.clone(), x, None, windows);
        let message = match (&self.across, &self.along, lines) {
            (Some(across), _, _) => across.forward(x.clone(), before, Some(neighbours), windows),
            (None, Some(along), Some(lines)) => along.forward(x.clone(), before, lines),
            _ => unreachable!("a layer is built with one kind of cross-attention, and lines are drawn for it"),
        };
        let both = Tensor::cat(vec![x.clone(), message], 3);
        x + self.norm.forward(self.narrow.forward(gelu(self.widen.forward(both))))
    }
}
