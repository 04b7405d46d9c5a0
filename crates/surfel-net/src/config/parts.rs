//! The settings of a network's parts, in the order in which they run.
//!
//! Invariant: they are data; what they may be is said in `check`, what they become in the folder of each part.

use crate::features::dino::DinoModel;
use serde::{Deserialize, Serialize};

/// Which backbone, and its width.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum BackboneConfig {
    /// The residual CNN of spec 2.2, trained from scratch.
    Cnn {
        /// Channels at stride 4, `C`.
        channels: usize,
        /// Channels of the two stages before.
        widths: [usize; 2],
    },
    /// The frozen pretrained trunk with a trained pyramid on top.
    Pretrained {
        /// Channels at stride 4, `C`.
        channels: usize,
    },
}

impl BackboneConfig {
    /// Channels at stride 4.
    pub fn channels(&self) -> usize {
        match self {
            Self::Cnn { channels, .. } | Self::Pretrained { channels } => *channels,
        }
    }
}

/// Spec 2.3.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransformerConfig {
    /// Layers, each self-attention then cross-attention.
    pub num_layers: usize,
    /// Windows per side.
    pub num_splits: usize,
    /// Hidden width of the feed-forward part over its input width `2 C`.
    pub expansion: usize,
    /// Cross-attention along epipolar lines; inside the windows when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub epipolar: Option<EpipolarConfig>,
}

/// Cross-attention of each pixel to samples of its epipolar line in every neighbour.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EpipolarConfig {
    /// Samples of a line between the ends of the depth range, uniform in inverse depth.
    pub num_samples: usize,
    /// Heads; divides the backbone's channels.
    pub num_heads: usize,
}

/// Frozen DINOv2 features (spec 1.10, row 3). Their weights are the user's own file, no part of this network's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DinoConfig {
    /// Which of the published models.
    pub model: DinoModel,
    /// Its weights; not written into weights files, where another machine's path would be of no use. Without it, the
    /// file is named by [`SurfelNet::with_dino`](crate::SurfelNet::with_dino).
    #[serde(default, skip_serializing)]
    pub file: Option<std::path::PathBuf>,
}

/// A U-Net (spec 2.6).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnetConfig {
    /// Base channels.
    pub channels: usize,
    /// Channels of each level over the base, finest first.
    pub multipliers: Vec<usize>,
    /// Downsampling ratios at which views attend to each other.
    pub attention_at: Vec<usize>,
}

impl UnetConfig {
    /// Input sizes must be divisible by this.
    pub fn stride(&self) -> usize {
        1 << (self.multipliers.len() - 1)
    }
}

/// Spec 2.4.1 to 2.4.3.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CostVolumeConfig {
    /// Depth candidates, uniform in disparity from far to near.
    pub num_candidates: usize,
    /// Regularisation.
    pub unet: UnetConfig,
}

/// A network whose coarse depth is a `seed::Seed` that matching gives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeededConfig {
    /// Distances in pixels at which the eight neighbours of a pixel propose their planes to it.
    pub distances: Vec<usize>,
    /// How often the refinement runs; each pass starts from the planes and the density of the one before.
    #[serde(default = "once")]
    pub passes: usize,
    /// Let proposals and corrections move the depth; without it matching's depth stays, and tilt, opacity and colour
    /// are the network's.
    #[serde(default = "yes")]
    pub moves_depth: bool,
}

fn yes() -> bool {
    true
}

fn once() -> usize {
    1
}

impl SeededConfig {
    /// Planes proposed to each pixel, its own included.
    pub fn num_proposals(&self) -> usize {
        1 + 8 * self.distances.len()
    }

    /// Where proposals come from, columns and rows, the pixel itself first.
    pub(crate) fn offsets(&self) -> Vec<[i32; 2]> {
        const AROUND: [[i32; 2]; 8] = [[-1, -1], [0, -1], [1, -1], [-1, 0], [1, 0], [-1, 1], [0, 1], [1, 1]];
        let ring = |&distance: &usize| AROUND.map(|offset| offset.map(|o| o * distance as i32));
        std::iter::once([0, 0]).chain(self.distances.iter().flat_map(ring)).collect()
    }
}

/// Spec 2.4.4 and 2.4.5.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefinementConfig {
    /// Input pixels per pixel of the refinement: 1 (the paper), 2 or 4.
    pub stride: usize,
    /// Channels of the upsampled matching features.
    pub upsampled_channels: usize,
    /// The U-Net; its base channels are the paper's `R`.
    pub unet: UnetConfig,
    /// A second, narrow sweep around the coarse depth; absent in the paper.
    pub sweep: Option<FineSweepConfig>,
}

/// The second sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FineSweepConfig {
    /// Candidates around the coarse disparity; odd, so that one is the coarse disparity itself.
    pub num_candidates: usize,
    /// Distance of candidates over that of the coarse sweep.
    pub step: f64,
    /// Channels that are matched.
    pub channels: usize,
}

/// Spec 2.7.1, 2.7.2.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadConfig {
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: usize,
    /// Smallest scale in units of 0.2 pixel footprints (spec 1.7).
    pub scale_min: f64,
    /// Largest scale in the same unit.
    pub scale_max: f64,
    /// Channels between the two convolutions; twice the outputs when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hidden_channels: Option<usize>,
}

/// Spec 1.9.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NyquistConfig {
    /// Widen surfels to what the views can sample before computing regions (paper: surfel adaptation).
    pub adaptation: bool,
    /// Standard deviation of the low-pass filter, pixels.
    pub s: f64,
    /// A pixel belongs to a region when it sees more than this of the surfel; below 1.
    pub epsilon: f64,
    /// Candidates of a region reach this many samples from its centre; at most 3.
    pub radius: usize,
    /// Spread the candidates when the footprint is larger than the radius.
    pub adaptive_stride: bool,
    /// A view samples a surfel whose centre falls outside the image by less than this fraction of its size.
    pub visibility_margin: f64,
}

/// Spec 2.7.4.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AggregationConfig {
    /// Refine features over the regions; without it the initial surfels are final.
    pub enabled: bool,
    /// Attention channels.
    pub channels: usize,
    /// Attention heads.
    pub num_heads: usize,
    /// Hidden width of the feed-forward part over the feature width.
    pub expansion: usize,
}
