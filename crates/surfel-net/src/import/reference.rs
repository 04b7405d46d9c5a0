//! Whose weights a file holds, and what is special about them.
//!
//! All names inside this module are those of the encoder, without the prefix that each kind of file has.

use super::{ImportError, Source};
use crate::config::NetConfig;
use crate::cost_volume::DepthRange;
use serde::Serialize;

/// An implementation whose weights can be imported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reference {
    /// The paper's release.
    SurfelSplat,
    /// Its predecessor, with three-dimensional Gaussians.
    MvSplat,
    /// A matching network with the same backbone and transformer (`gmdepth`).
    UniMatch,
}

const ENCODER: &str = "encoder.";
/// Raw attributes of an MVSplat Gaussian before its harmonics: offset (2), scales (3), quaternion x y z w (4).
const MVSPLAT_SH: usize = 9;
/// Of a released surfel: offset (2), scales (2), quaternion w x y z (4).
const RELEASE_SH: usize = 8;
/// Coefficients per colour of both, degree 4.
const SH_PER_COLOUR: usize = 25;

impl Reference {
    /// Tells by the names.
    pub(super) fn of(source: &Source) -> Result<Self, ImportError> {
        let has = |prefix: &str| source.names().any(|name| name.starts_with(prefix));
        let release = ["encoder.depth_predictor.to_gaussian.", "encoder.gaussian_head."];
        if release.iter().any(|prefix| has(prefix)) {
            Ok(Self::SurfelSplat)
        } else if has("encoder.depth_predictor.") && has("encoder.backbone.") {
            Ok(Self::MvSplat)
        } else if has("backbone.") && has("transformer.") {
            Ok(Self::UniMatch)
        } else {
            let examples: Vec<&str> = source.names().take(3).collect();
            let examples = if examples.is_empty() { "(there are none)".to_owned() } else { examples.join(", ") };
            Err(ImportError::Unknown { file: source.file().to_owned(), examples })
        }
    }

    /// The name in the file of a tensor of the encoder.
    pub(super) fn full_name(self, name: &str) -> String {
        match self {
            Self::SurfelSplat | Self::MvSplat => format!("{ENCODER}{name}"),
            Self::UniMatch => name.strip_prefix("backbone.").unwrap_or(name).to_owned(),
        }
    }

    /// Prefix of the attribute head; UniMatch has none.
    pub(super) fn head(self) -> Option<&'static str> {
        match self {
            Self::SurfelSplat => Some("depth_predictor.to_gaussian.head"),
            Self::MvSplat => Some("depth_predictor.to_gaussians"),
            Self::UniMatch => None,
        }
    }

    /// Which outputs of its head are ours, in our order: scales, quaternion w x y z, harmonics by colour.
    pub(super) fn head_outputs(self, num_sh: usize) -> Vec<usize> {
        let (shape, first_sh): (&[usize], _) = match self {
            Self::MvSplat => (&[2, 3, 8, 5, 6, 7], MVSPLAT_SH),
            Self::SurfelSplat | Self::UniMatch => (&[2, 3, 4, 5, 6, 7], RELEASE_SH),
        };
        let harmonics = (0..3).flat_map(|colour| (0..num_sh).map(move |n| first_sh + SH_PER_COLOUR * colour + n));
        shape.iter().copied().chain(harmonics).collect()
    }

    /// The depth range in whose disparities its refinement works; `None` where disparities are relative already.
    pub(super) fn absolute_disparity(self) -> Option<DepthRange> {
        (self == Self::MvSplat).then_some(DepthRange { near: 1.0, far: 100.0 })
    }

    /// The configuration with what only the source can know.
    pub(super) fn adapted(self, mut config: NetConfig, source: &Source, notes: &mut Vec<String>) -> NetConfig {
        let first = self.head().and_then(|head| source.shape(&self.full_name(&format!("{head}.0.weight"))));
        let Some(&[hidden, inputs, ..]) = first else { return config };
        if inputs != config.feature_channels() || !(1..=4096).contains(&hidden) {
            return config;
        }
        config.head.hidden_channels = Some(hidden);
        let dropped = match self {
            Self::MvSplat => {
                (config.head.scale_min, config.head.scale_max) = (0.5, 15.0);
                "the image offsets, the third scale and harmonics beyond the configured degree were dropped, the quaternion reordered from x y z w"
            }
            _ => "the image offsets and harmonics beyond the configured degree were dropped",
        };
        notes.push(format!("the head keeps the source's {hidden} hidden channels; {dropped}"));
        config
    }

    /// Why a tensor was left that nothing of ours asked for.
    pub(super) fn why_left(self, name: &str) -> &'static str {
        let Some(name) = name.strip_prefix(ENCODER).or((self == Self::UniMatch).then_some(name)) else {
            return "is no part of the encoder";
        };
        if name.starts_with("depth_predictor.dinov2") || name.starts_with("depth_predictor.monocular") {
            "belongs to monocular depth, which this network does not use"
        } else if name.starts_with("feature_aggregation.") {
            "belongs to the release's attention inside each view; aggregation over views is another module"
        } else if name.starts_with("gaussian_head.") {
            "is a second copy of the head"
        } else if self == Self::SurfelSplat && name.starts_with("depth_predictor.to_gaussians.") {
            "is a head that the release never runs"
        } else {
            "has no counterpart in this configuration"
        }
    }
}
