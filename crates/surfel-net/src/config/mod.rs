//! The settings of one network, read from TOML, and the presets.
//!
//! Everything the graph depends on is here; nothing else decides a shape. Invariant: a configuration that
//! passed [`NetConfig::from_toml`] builds without a panic, and an unknown key is an error, not a silent default.

mod check;
mod parts;

pub use crate::features::dino::DinoModel;
pub use parts::*;
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
            Preset::Paper => include_str!("../../presets/paper.toml"),
            Preset::Small => include_str!("../../presets/small.toml"),
            Preset::Narrow => include_str!("../../presets/narrow.toml"),
            Preset::Tiny => include_str!("../../presets/tiny.toml"),
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

    /// How often depth is refined: more than once only where it starts from matching.
    pub fn passes(&self) -> usize {
        self.seeded.as_ref().map_or(1, |seeded| seeded.passes)
    }

    /// Channels of the feature each surfel is decoded from, the paper's `F` (spec 2.4.6).
    ///
    /// A seeded network adds the normal of the refined plane and the density.
    pub fn feature_channels(&self) -> usize {
        let geometry = if self.seeded.is_some() { 4 } else { 0 };
        self.refinement.unet.channels + 3 + self.refinement.upsampled_channels + geometry
    }
}

fn lcm(a: usize, b: usize) -> usize {
    let (mut x, mut y) = (a, b);
    while y != 0 {
        (x, y) = (y, x % y);
    }
    a / x * b
}
