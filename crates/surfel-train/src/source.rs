//! Where samples come from: one number, one sample.
//!
//! Rendered scans (`surfel-synth`, a folder of assets) or analytic scenes (nothing needed). Invariant: a sample
//! depends on the source's settings and its number alone, so any sample can be made again, in any order.

use crate::error::TrainError;
use crate::sample::Sample;
use serde::{Deserialize, Serialize};
use std::path::Path;
use surfel_synth::{AssetLibrary, Random, SceneKind, SceneOptions, SceneSampler, Split, SynthConfig};

/// What a source photographs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SourceKind {
    /// Scanned objects from a folder of assets.
    Scans,
    /// Analytic shapes; nothing is needed.
    Analytic,
}

/// Settings of a source.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourceConfig {
    /// What is photographed.
    pub kind: SourceKind,
    /// Names the sequence of scenes.
    pub seed: u64,
    /// Image columns.
    pub width: usize,
    /// Image rows.
    pub height: usize,
    /// Views per scene.
    pub num_views: usize,
    /// Share of rooms among rendered scenes.
    pub room_share: f64,
    /// Angle between neighbouring cameras around scans, degrees, least and most.
    #[serde(default = "usual_angles")]
    pub pair_angle_deg: [f64; 2],
    /// How bad the cameras around scans are: factor of noise, changes of exposure and share of JPEG; 0 = flawless.
    #[serde(default = "usual_defects")]
    pub defects: f64,
    /// Sharpening by the cameras around scans, least and most.
    #[serde(default)]
    pub sharpening: [f64; 2],
}

fn usual_angles() -> [f64; 2] {
    SynthConfig::default().pair_angle_deg
}

fn usual_defects() -> f64 {
    1.0
}

impl SourceConfig {
    /// What tells its samples from those of other settings, as the name of a folder.
    pub(crate) fn folder_name(&self, side: &str) -> String {
        let Self {
            kind,
            seed,
            width,
            height,
            num_views,
            room_share,
            pair_angle_deg: [least, most],
            defects,
            sharpening,
        } = self;
        let kind = if *kind == SourceKind::Scans { "scans" } else { "analytic" };
        let [rooms, defects] = [room_share, defects].map(|share| (100.0 * share).round());
        let [dull, sharp] = sharpening.map(|amount| (100.0 * amount).round());
        let sharpening = if sharp > 0.0 { format!("-{dull}to{sharp}sharp") } else { String::new() };
        format!(
            "{side}-{kind}-{width}x{height}-{num_views}views-{rooms}rooms-{least}to{most}deg-{defects}defects{sharpening}-seed{seed}"
        )
    }
}

/// A source, opened for one side of the split.
pub enum Source {
    /// Photographs of scanned objects.
    Scans {
        /// The assets.
        library: Box<AssetLibrary>,
        /// The settings.
        config: SourceConfig,
    },
    /// Photographs of analytic shapes.
    Analytic(SourceConfig),
}

impl Source {
    /// Opens one side of the assets, which analytic scenes do without.
    ///
    /// # Errors
    /// [`TrainError::NoAssets`] when there are none, [`TrainError::Assets`] when the folder lacks something.
    pub fn open(config: &SourceConfig, split: Split, assets: Option<&Path>) -> Result<Self, TrainError> {
        match (config.kind, assets) {
            (SourceKind::Analytic, _) => Ok(Self::Analytic(config.clone())),
            (SourceKind::Scans, None) => Err(TrainError::NoAssets),
            (SourceKind::Scans, Some(folder)) => {
                let library = Box::new(AssetLibrary::open(folder, split)?);
                Ok(Self::Scans { library, config: config.clone() })
            }
        }
    }

    /// The sample with a number.
    ///
    /// # Errors
    /// When an asset cannot be read or the scene shows nothing.
    pub fn sample(&self, number: u64) -> Result<Sample, TrainError> {
        let config = self.config();
        let mut random = Random::fork(config.seed, number);
        let seed = random.bits();
        let rendered: Vec<_> = match self {
            Self::Scans { library, config } => {
                let usual = SynthConfig::default();
                let synth = SynthConfig {
                    width: config.width,
                    height: config.height,
                    num_views: config.num_views,
                    room_share: config.room_share,
                    pair_angle_deg: config.pair_angle_deg,
                    exposure_stops: config.defects * usual.exposure_stops,
                    noise: config.defects * usual.noise,
                    sharpening: config.sharpening,
                    jpeg: ((config.defects * usual.jpeg.0).min(1.0), usual.jpeg.1),
                    ..usual
                };
                let scene = SceneSampler::new(library, synth).scene(seed)?;
                (0..scene.num_views()).map(|view| scene.render(view)).collect()
            }
            Self::Analytic(config) => {
                let kinds = [SceneKind::StillLife, SceneKind::Boxes, SceneKind::HeightField, SceneKind::Torus];
                let options = SceneOptions {
                    kind: kinds[(seed % kinds.len() as u64) as usize],
                    seed,
                    width: config.width,
                    height: config.height,
                    num_views: config.num_views,
                    pair_angle_deg: random.range(6.0, 20.0),
                    noise: 0.01,
                    ..SceneOptions::default()
                };
                options.render()
            }
        };
        Sample::of(&rendered, &mut random)
    }

    fn config(&self) -> &SourceConfig {
        match self {
            Self::Scans { config, .. } | Self::Analytic(config) => config,
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Settings of small analytic pairs.
    pub(crate) fn config(seed: u64) -> SourceConfig {
        SourceConfig {
            kind: SourceKind::Analytic,
            seed,
            width: 48,
            height: 32,
            num_views: 2,
            room_share: 0.0,
            pair_angle_deg: usual_angles(),
            defects: 1.0,
            sharpening: [0.0; 2],
        }
    }

    /// The first of them.
    pub(crate) fn analytic(seed: u64) -> Sample {
        Source::open(&config(seed), Split::Train, None).unwrap().sample(0).unwrap()
    }
}
