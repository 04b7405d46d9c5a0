//! Cross-attention along epipolar lines: a pixel asks only where it can be seen (paper: the epipolar transformer).
//!
//! A sample is the neighbour's feature where a candidate of depth lands, beside a code of that depth; keys and values
//! are linear in both. Invariant: depth enters relative to the range, so the unit of the scene does not matter.

use super::layer::linear;
use crate::config::EpipolarConfig;
use crate::layers::Linear;
use crate::ops::epipolar::EpipolarLines;
use crate::ops::epipolar_attention;
use burn::module::Module;
use burn::nn::{LayerNorm, LayerNormConfig};
use burn::tensor::{Device, Tensor, TensorData};
use std::f64::consts::PI;
use std::sync::Arc;

/// Frequencies of the code of depth, each twice the one before; the last tells apart samples 1/32 of the range apart.
const OCTAVES: usize = 6;

/// Projections, and a normalised output.
#[derive(Module, Debug)]
pub(super) struct LineAttention {
    query: Linear,
    key: Linear,
    value: Linear,
    depth_key: Linear,
    depth_value: Linear,
    merge: Linear,
    norm: LayerNorm,
    num_heads: usize,
}

impl LineAttention {
    pub(super) fn new(channels: usize, config: &EpipolarConfig, device: &Device) -> Self {
        let project = |inputs| linear(inputs, channels, device);
        Self {
            query: project(channels),
            key: project(channels),
            value: project(channels),
            depth_key: project(2 * OCTAVES),
            depth_value: project(2 * OCTAVES),
            merge: project(channels),
            norm: LayerNormConfig::new(channels).init(device),
            num_heads: config.num_heads,
        }
    }

    /// `x` `[views, height, width, C]` attending to the maps `memory` of its neighbours along `lines`.
    pub(super) fn forward(&self, x: Tensor<4>, memory: Tensor<4>, lines: &Arc<EpipolarLines>) -> Tensor<4> {
        let code = depth_code(lines.num_candidates(), &x.device());
        // Interpolation is linear, so whole maps are projected once, not every sample.
        let maps = [self.key.forward(memory.clone()), self.value.forward(memory)];
        let depths = [self.depth_key.forward(code.clone()), self.depth_value.forward(code)];
        let y = epipolar_attention(self.query.forward(x), maps, depths, self.num_heads, lines.clone());
        self.norm.forward(self.merge.forward(y))
    }
}

/// `[candidates, 2 OCTAVES]`: sine and cosine of each octave of relative disparity, 0 at the far end and 1 at the near.
fn depth_code(num_candidates: usize, device: &Device) -> Tensor<2> {
    let angle = |j: usize, octave: usize| PI * f64::from(1 << octave) * j as f64 / (num_candidates - 1) as f64;
    let row =
        |j: usize| (0..OCTAVES).flat_map(move |octave| [angle(j, octave).sin() as f32, angle(j, octave).cos() as f32]);
    let values: Vec<f32> = (0..num_candidates).flat_map(row).collect();
    Tensor::from_data(TensorData::new(values, [num_candidates, 2 * OCTAVES]), device)
}
