//! The settings of one network, read from TOML, and the three presets.
//!
//! Everything the graph depends on is here; nothing else decides a shape. Invariant: a configuration that
//! passed [`NetConfig::from_toml`] builds without a panic, and an unknown key is an error, not a silent default.

pub use crate::features::dino::DinoModel;
use serde::{Deserialize, Serialize};

/// A network's settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetConfig {
    /// How many other views each view looks at (matching, cross-attention, aggregation).
    pub num_neighbours: usize,
    /// Per-view features at stride 4.
    pub backbone: BackboneConfig,
    /// Multi-view transformer; absent in a seeded network.
    pub transformer: Option<TransformerConfig>,
    /// Plane sweep and its regularisation at stride 4; absent in a seeded network.
    pub cost_volume: Option<CostVolumeConfig>,
    /// Coarse depth from matching instead of a cost volume of the network's own.
    pub seeded: Option<SeededConfig>,
    /// Refinement towards full resolution.
    pub refinement: RefinementConfig,
    /// Frozen DINOv2 features added to the backbone's; absent in every preset.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dino: Option<DinoConfig>,
    /// Surfel attributes.
    pub head: HeadConfig,
    /// Surfel adaptation and footprint regions.
    pub nyquist: NyquistConfig,
    /// Cross-view feature aggregation.
    pub aggregation: AggregationConfig,
}

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
    /// Let proposals and corrections move the depth; without it matching's depth stays, and tilt, opacity and colour
    /// are the network's.
    #[serde(default = "yes")]
    pub moves_depth: bool,
}

fn yes() -> bool {
    true
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

/// Why a configuration is refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// Not TOML, a key that does not exist, a missing key, or a value of another type.
    #[error("the network configuration cannot be read: {0}")]
    Syntax(#[from] toml::de::Error),
    /// A value the network cannot be built with.
    #[error("in the network configuration, {key} is {value}; it must be {expected}")]
    Value {
        /// The key.
        key: &'static str,
        /// What it is.
        value: String,
        /// What it may be.
        expected: &'static str,
    },
}

/// The configurations that ship with the crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// As the paper describes it; heavy.
    Paper,
    /// The one that ships: matching's depth, refined on pretrained features; for two CPU cores.
    Small,
    /// The paper's graph, narrow and on pretrained features: finds depth by its own cost volume. No weights ship.
    Narrow,
    /// For tests.
    Tiny,
}

impl NetConfig {
    /// A shipped configuration.
    pub fn preset(preset: Preset) -> Self {
        let text = match preset {
            Preset::Paper => include_str!("../presets/paper.toml"),
            Preset::Small => include_str!("../presets/small.toml"),
            Preset::Narrow => include_str!("../presets/narrow.toml"),
            Preset::Tiny => include_str!("../presets/tiny.toml"),
        };
        Self::from_toml(text).expect("a test parses every preset")
    }

    /// Reads and checks a configuration.
    ///
    /// # Errors
    /// [`ConfigError`] for anything the network could not be built from.
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        let config: Self = toml::from_str(text)?;
        config.check()?;
        Ok(config)
    }

    /// As TOML that [`NetConfig::from_toml`] reads back.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("numbers, text and lists are TOML")
    }

    /// Image sides are padded to a multiple of this before they enter the network.
    pub fn size_multiple(&self) -> usize {
        let volume = self.cost_volume.as_ref().map_or(1, |volume| volume.unet.stride());
        let coarse = 4 * lcm(volume, self.transformer.as_ref().map_or(1, |t| t.num_splits));
        let pretrained = if matches!(self.backbone, BackboneConfig::Pretrained { .. }) { 16 } else { 4 };
        lcm(lcm(coarse, self.refinement.stride * self.refinement.unet.stride()), pretrained)
    }

    /// Channels of the feature each surfel is decoded from, the paper's `F` (spec 2.4.6).
    ///
    /// A seeded network adds the normal of the refined plane and the density.
    pub fn feature_channels(&self) -> usize {
        let geometry = if self.seeded.is_some() { 4 } else { 0 };
        self.refinement.unet.channels + 3 + self.refinement.upsampled_channels + geometry
    }

    fn check(&self) -> Result<(), ConfigError> {
        let require = |ok: bool, key, value: String, expected| {
            if ok { Ok(()) } else { Err(ConfigError::Value { key, value, expected }) }
        };
        let count = |key, value: usize, most: usize, expected| {
            require((1..=most).contains(&value), key, value.to_string(), expected)
        };
        let channels = |key, value: usize| {
            let expected = "a multiple of 4 between 4 and 4096";
            require(value.is_multiple_of(4) && (4..=4096).contains(&value), key, value.to_string(), expected)
        };
        count("num_neighbours", self.num_neighbours, 64, "between 1 and 64")?;
        channels("backbone.channels", self.backbone.channels())?;
        if let BackboneConfig::Cnn { widths, .. } = &self.backbone {
            widths.iter().try_for_each(|&width| channels("backbone.widths", width))?;
        }
        let own = self.transformer.is_some() && self.cost_volume.is_some();
        let absent = self.transformer.is_none() && self.cost_volume.is_none();
        let ok = if self.seeded.is_some() { absent } else { own };
        let expected = "there when [transformer] and [cost_volume] are not, and absent when both are";
        require(ok, "[seeded]", if self.seeded.is_some() { "there" } else { "absent" }.to_owned(), expected)?;
        if let Some(seeded) = &self.seeded {
            let distances = &seeded.distances;
            count("the number of seeded.distances", distances.len(), 4, "between 1 and 4")?;
            distances.iter().try_for_each(|&d| count("seeded.distances", d, 256, "between 1 and 256"))?;
        }
        if let Some(transformer) = &self.transformer {
            count("transformer.num_layers", transformer.num_layers, 64, "between 1 and 64")?;
            count("transformer.num_splits", transformer.num_splits, 64, "between 1 and 64")?;
            count("transformer.expansion", transformer.expansion, 16, "between 1 and 16")?;
            if let Some(EpipolarConfig { num_samples, num_heads }) = transformer.epipolar {
                let (key, expected) = ("transformer.epipolar.num_samples", "between 2 and 1024");
                require((2..=1024).contains(&num_samples), key, num_samples.to_string(), expected)?;
                let divides = num_heads > 0 && self.backbone.channels().is_multiple_of(num_heads);
                let (key, expected) = ("transformer.epipolar.num_heads", "a divisor of backbone.channels");
                require(divides, key, num_heads.to_string(), expected)?;
            }
        }
        if let Some(volume) = &self.cost_volume {
            let candidates = volume.num_candidates;
            let expected = "between 2 and 4096";
            require((2..=4096).contains(&candidates), "cost_volume.num_candidates", candidates.to_string(), expected)?;
        }
        for unet in self.cost_volume.iter().map(|volume| &volume.unet).chain([&self.refinement.unet]) {
            channels("unet.channels", unet.channels)?;
            count("the number of unet.multipliers", unet.multipliers.len(), 8, "between 1 and 8")?;
            unet.multipliers.iter().try_for_each(|&m| count("unet.multipliers", m, 16, "between 1 and 16"))?;
            for (level, multiplier) in unet.multipliers.iter().enumerate() {
                let width = unet.channels * multiplier;
                let attends = unet.attention_at.contains(&(1 << level));
                let ok = !attends || width < 32 || width.is_multiple_of(32);
                require(
                    ok,
                    "unet.channels times a multiplier",
                    width.to_string(),
                    "a multiple of 32 where views attend",
                )?;
            }
        }
        let stride = self.refinement.stride;
        require(matches!(stride, 1 | 2 | 4), "refinement.stride", stride.to_string(), "1, 2 or 4")?;
        channels("refinement.upsampled_channels", self.refinement.upsampled_channels)?;
        if let Some(sweep) = &self.refinement.sweep {
            let odd = sweep.num_candidates % 2 == 1 && sweep.num_candidates < 256;
            require(odd, "refinement.sweep.num_candidates", sweep.num_candidates.to_string(), "odd and below 256")?;
            let ok = sweep.step > 0.0 && sweep.step.is_finite();
            require(ok, "refinement.sweep.step", sweep.step.to_string(), "a finite number above 0")?;
            channels("refinement.sweep.channels", sweep.channels)?;
        }
        let HeadConfig { sh_degree, scale_min, scale_max, hidden_channels } = self.head;
        require(sh_degree <= 3, "head.sh_degree", sh_degree.to_string(), "between 0 and 3")?;
        let ordered = scale_min > 0.0 && scale_max > scale_min && scale_max.is_finite();
        require(ordered, "head.scale_max", scale_max.to_string(), "finite and above head.scale_min, which is above 0")?;
        count("head.hidden_channels", hidden_channels.unwrap_or(1), 4096, "between 1 and 4096")?;
        let nyquist = &self.nyquist;
        require(
            nyquist.s > 0.0 && nyquist.s.is_finite(),
            "nyquist.s",
            nyquist.s.to_string(),
            "a finite number above 0",
        )?;
        let open = nyquist.epsilon > 0.0 && nyquist.epsilon < 1.0;
        require(open, "nyquist.epsilon", nyquist.epsilon.to_string(), "between 0 and 1, exclusive")?;
        count("nyquist.radius", nyquist.radius, 3, "between 1 and 3")?;
        let margin = nyquist.visibility_margin;
        require((0.0..=10.0).contains(&margin), "nyquist.visibility_margin", margin.to_string(), "between 0 and 10")?;
        let aggregation = &self.aggregation;
        channels("aggregation.channels", aggregation.channels)?;
        let divides = aggregation.num_heads > 0 && aggregation.channels.is_multiple_of(aggregation.num_heads);
        require(
            divides,
            "aggregation.num_heads",
            aggregation.num_heads.to_string(),
            "a divisor of aggregation.channels",
        )?;
        count("aggregation.expansion", aggregation.expansion, 16, "between 1 and 16")
    }
}

fn lcm(a: usize, b: usize) -> usize {
    let (mut x, mut y) = (a, b);
    while y != 0 {
        (x, y) = (y, x % y);
    }
    a / x * b
}
