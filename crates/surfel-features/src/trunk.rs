//! The layer table of EfficientNet-Lite0 up to stride 16, and how its weights are read.
//!
//! Invariant: BatchNorm (epsilon 1e-3) is folded into the convolution before it while loading, so
//! running the trunk knows nothing of it.

use crate::block::Block;
use crate::depthwise::Depthwise;
use crate::pointwise::Pointwise;
use crate::stem::Stem;
use crate::weights::{TensorFile, WeightsError};
use crate::{FeatureMap, Stage};
use surfel_core::Grid;

/// Epsilon of the trained BatchNorm layers.
const BATCH_NORM_EPSILON: f32 = 1e-3;
/// Channels after the stem.
const STEM_CHANNELS: usize = 32;
/// The image is padded to a multiple of this, whatever stages are asked for.
const PADDED_TO: usize = 16;

/// Output channels, depthwise kernel, stride, expansion factor of blocks 0 to 10.
const BLOCKS: [(usize, usize, usize, usize); 11] = [
    (16, 3, 1, 1),
    (24, 3, 2, 6),
    (24, 3, 1, 6),
    (40, 5, 2, 6),
    (40, 5, 1, 6),
    (80, 3, 2, 6),
    (80, 3, 1, 6),
    (80, 3, 1, 6),
    (112, 5, 1, 6),
    (112, 5, 1, 6),
    (112, 5, 1, 6),
];

/// Stem and blocks with folded weights.
#[derive(Clone, Debug)]
pub(super) struct Trunk {
    stem: Stem,
    blocks: Vec<Block>,
}

/// The block after which a stage is read.
const fn last_block(stage: Stage) -> usize {
    match stage {
        Stage::S4 => 2,
        Stage::S8 => 4,
        Stage::S16 => 10,
    }
}

impl Trunk {
    pub(super) fn load(file: &TensorFile) -> Result<Self, WeightsError> {
        let (weights, bias) = folded(file, "_conv_stem", "_bn0", [STEM_CHANNELS, 3, 3, 3])?;
        let stem = Stem::new(&weights, &bias);
        let mut num_inputs = STEM_CHANNELS;
        let mut blocks = Vec::with_capacity(BLOCKS.len());
        for (i, (num_outputs, kernel, stride, expansion)) in BLOCKS.into_iter().enumerate() {
            let name = |layer: &str| format!("_blocks.{i}.{layer}");
            let wide = num_inputs * expansion;
            let expand = if expansion > 1 {
                let (w, b) = folded(file, &name("_expand_conv"), &name("_bn0"), [wide, num_inputs, 1, 1])?;
                Some(Pointwise::new(&w, &b, num_inputs))
            } else {
                None
            };
            let (w, b) = folded(file, &name("_depthwise_conv"), &name("_bn1"), [wide, 1, kernel, kernel])?;
            let depthwise = Depthwise::new(&w, b, kernel, stride);
            let (w, b) = folded(file, &name("_project_conv"), &name("_bn2"), [num_outputs, wide, 1, 1])?;
            let project = Pointwise::new(&w, &b, wide);
            blocks.push(Block { expand, depthwise, project });
            num_inputs = num_outputs;
        }
        Ok(Self { stem, blocks })
    }

    /// Multiplications with addition of [`Self::run`].
    pub(super) fn multiply_adds(&self, width: usize, height: usize, stages: &[Stage]) -> u64 {
        let Some(last) = stages.iter().map(|&s| last_block(s)).max() else {
            return 0;
        };
        // The stem halves the padded image; each block works at the size it leaves.
        let mut pixels = (width.next_multiple_of(PADDED_TO) * height.next_multiple_of(PADDED_TO) / 4) as u64;
        let mut sum = pixels * (STEM_CHANNELS * 3 * 9) as u64;
        for block in &self.blocks[..=last] {
            let expanded = block.expand.as_ref().map_or(0, |expand| pixels * expand.num_weights());
            pixels /= (block.depthwise.stride * block.depthwise.stride) as u64;
            let taps = block.depthwise.channels * block.depthwise.kernel * block.depthwise.kernel;
            sum += expanded + pixels * (taps as u64 + block.project.num_weights());
        }
        sum
    }

    /// Each asked stage once, at the padded size.
    pub(super) fn run(&self, image: &Grid<[f32; 3]>, stages: &[Stage]) -> Vec<(Stage, FeatureMap)> {
        let Some(last) = stages.iter().map(|&s| last_block(s)).max() else {
            return Vec::new();
        };
        if image.is_empty() {
            return stages
                .iter()
                .map(|&s| {
                    (
                        s,
                        FeatureMap {
                            channels: s.channels(),
                            width: 0,
                            height: 0,
                            stride: s.stride(),
                            data: Vec::new(),
                        },
                    )
                })
                .collect();
        }
        let padded = |n: usize| n.next_multiple_of(PADDED_TO);
        let mut map = self.stem.run(image, padded(image.width()), padded(image.height()));
        let mut found = Vec::new();
        for (i, block) in self.blocks[..=last].iter().enumerate() {
            map = block.run(&map);
            let stage = [Stage::S4, Stage::S8, Stage::S16].into_iter().find(|&s| last_block(s) == i);
            if let Some(stage) = stage.filter(|s| stages.contains(s)) {
                found.push((stage, map.clone()));
            }
        }
        found
    }
}

/// Weights and bias of a convolution followed by BatchNorm.
fn folded(file: &TensorFile, conv: &str, norm: &str, shape: [usize; 4]) -> Result<(Vec<f32>, Vec<f32>), WeightsError> {
    let mut weights = file.values(&format!("{conv}.weight"), &shape)?;
    let norm_values = |part: &str| file.values(&format!("{norm}.{part}"), &shape[..1]);
    let (gain, offset) = (norm_values("weight")?, norm_values("bias")?);
    let (mean, variance) = (norm_values("running_mean")?, norm_values("running_var")?);
    let mut bias = Vec::with_capacity(shape[0]);
    for (n, filter) in weights.chunks_exact_mut(shape[1] * shape[2] * shape[3]).enumerate() {
        let scale = gain[n] / (variance[n].max(0.0) + BATCH_NORM_EPSILON).sqrt();
        filter.iter_mut().for_each(|w| *w *= scale);
        bias.push(offset[n] - mean[n] * scale);
    }
    Ok((weights, bias))
}
