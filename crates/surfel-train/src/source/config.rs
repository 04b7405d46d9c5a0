//! The settings of a source, as they stand in TOML: what every source has, and what its kind has.
//!
//! `kind` names the kind; the keys of the other kinds are not known to it. Invariant: settings that passed
//! [`SourceConfig::check`] can be asked for samples, so far as files allow.

use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use surfel_data::choice::Ramp;
use surfel_synth::{Random, SynthConfig};

/// Settings of a source.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SourceConfig {
    /// Names the sequence of samples.
    pub seed: u64,
    /// Image columns.
    pub width: usize,
    /// Image rows.
    pub height: usize,
    /// Views the network is given.
    pub num_views: usize,
    /// Views it is not given, held out to be rendered and compared.
    #[serde(default)]
    pub num_targets: usize,
    /// What is photographed.
    #[serde(flatten)]
    pub scenes: Scenes,
}

/// Where the scenes of a source come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Scenes {
    /// Scanned objects from a folder of assets, rendered.
    Scans(Scans),
    /// Analytic shapes, rendered; nothing is needed.
    Analytic(Analytic),
    /// Clips of RealEstate10K.
    Re10k(Clips),
    /// Clips of ACID, packed alike.
    Acid(Clips),
    /// DTU as MVSNet trains on it.
    Dtu(Dtu),
    /// BlendedMVS.
    BlendedMvs(BlendedMvs),
}

/// How scanned objects are photographed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scans {
    /// Share of rooms among the scenes.
    pub room_share: f64,
    /// Share of buildings under an open sky among those that are no rooms.
    #[serde(default)]
    pub street_share: f64,
    /// Angle between neighbouring cameras, degrees, least and most.
    #[serde(default = "usual_angles")]
    pub pair_angle_deg: [f64; 2],
    /// How bad the cameras are: factor of noise, changes of exposure and share of JPEG; 0 = flawless.
    #[serde(default = "usual_defects")]
    pub defects: f64,
    /// Sharpening by the cameras, least and most.
    #[serde(default)]
    pub sharpening: [f64; 2],
    /// How far cameras are from where they are said to look: pixels across the epipolar lines, the most that a scene's
    /// standard deviation can be.
    #[serde(default)]
    pub turned_px: f64,
}

/// Analytic shapes have no settings of their own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Analytic {}

/// Which frames of a clip make a sample (spec 4.5).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Clips {
    /// The folder of `index.json` and the chunks it lists.
    pub folder: PathBuf,
    /// Fewest frames from the first to the last view.
    pub min_gap: usize,
    /// Most frames from the first to the last view.
    pub max_gap: usize,
    /// Easier samples to begin with, which a run sees in the order of their numbers; without it all are alike.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<Beginning>,
}

/// Gaps that grow, from sample to sample, to those of [`Clips`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Beginning {
    /// Fewest frames of the first sample.
    pub min_gap: usize,
    /// Most frames of the first sample.
    pub max_gap: usize,
    /// Samples after which the gaps are those of [`Clips`].
    pub over: usize,
}

impl Clips {
    /// Fewest and most frames, by the number of the sample.
    pub(super) fn gaps(&self) -> [Ramp; 2] {
        let ends = [self.min_gap, self.max_gap];
        match self.from {
            None => ends.map(Ramp::constant),
            Some(Beginning { min_gap, max_gap, over }) => {
                std::array::from_fn(|i| Ramp { first: [min_gap, max_gap][i], last: ends[i], steps: over })
            }
        }
    }
}

/// Which photographs of DTU are used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dtu {
    /// The folder of `Cameras`, `Rectified` and `Depths`.
    pub folder: PathBuf,
    /// The light, 0 to 6.
    #[serde(default = "usual_light")]
    pub light: usize,
}

/// Which scenes of BlendedMVS are used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlendedMvs {
    /// The folder of the scenes' folders.
    pub folder: PathBuf,
    /// A file in it that names the scenes to use, one a line; all without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub list: Option<PathBuf>,
}

fn usual_angles() -> [f64; 2] {
    SynthConfig::default().pair_angle_deg
}

fn usual_defects() -> f64 {
    1.0
}

fn usual_light() -> usize {
    3
}

impl Scenes {
    /// The kind, as in TOML.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Scans(_) => "scans",
            Self::Analytic(_) => "analytic",
            Self::Re10k(_) => "re10k",
            Self::Acid(_) => "acid",
            Self::Dtu(_) => "dtu",
            Self::BlendedMvs(_) => "blended_mvs",
        }
    }

    /// The folder of a set of photographs; `None` for scenes that are rendered.
    pub fn folder(&self) -> Option<&Path> {
        match self {
            Self::Scans(_) | Self::Analytic(_) => None,
            Self::Re10k(clips) | Self::Acid(clips) => Some(&clips.folder),
            Self::Dtu(dtu) => Some(&dtu.folder),
            Self::BlendedMvs(blended) => Some(&blended.folder),
        }
    }

    /// Whether samples grow harder with their numbers, and are to be seen in that order.
    pub(crate) fn grow(&self) -> bool {
        matches!(self, Self::Re10k(clips) | Self::Acid(clips) if clips.from.is_some())
    }

    /// What tells these scenes from others of their kind, as part of the name of a folder.
    fn name(&self) -> String {
        match self {
            Self::Scans(scans) => {
                let Scans { room_share, street_share, pair_angle_deg: [least, most], defects, sharpening, turned_px } =
                    scans;
                let [rooms, streets, defects] =
                    [room_share, street_share, defects].map(|share| (100.0 * share).round());
                let streets = if streets > 0.0 { format!("-{streets}streets") } else { String::new() };
                let [dull, sharp] = sharpening.map(|amount| (100.0 * amount).round());
                let sharpening = if sharp > 0.0 { format!("-{dull}to{sharp}sharp") } else { String::new() };
                let turned = if *turned_px > 0.0 { format!("-{}turned", 100.0 * turned_px) } else { String::new() };
                format!("-{rooms}rooms{streets}-{least}to{most}deg-{defects}defects{sharpening}{turned}")
            }
            Self::Analytic(_) => String::new(),
            Self::Re10k(clips) | Self::Acid(clips) => {
                let Clips { folder, min_gap, max_gap, from } = clips;
                let grown = |Beginning { min_gap, max_gap, over }| format!("-from{min_gap}to{max_gap}over{over}");
                let from = from.map(grown).unwrap_or_default();
                format!("-gap{min_gap}to{max_gap}{from}-{}", short_name(folder))
            }
            Self::Dtu(Dtu { folder, light }) => format!("-light{light}-{}", short_name(folder)),
            Self::BlendedMvs(BlendedMvs { folder, list }) => {
                format!("-{}", short_name(&folder.join(list.as_deref().unwrap_or(Path::new("")))))
            }
        }
    }
}

/// A number that tells a path from others.
fn short_name(path: &Path) -> String {
    let bytes = path.as_os_str().as_encoded_bytes();
    format!("{:016x}", bytes.iter().fold(0, |code, byte| Random::fork(code, u64::from(*byte)).bits()))
}

impl SourceConfig {
    /// What tells its samples from those of other settings, as the name of a folder.
    pub(crate) fn folder_name(&self, side: &str) -> String {
        let Self { seed, width, height, num_views, num_targets, scenes } = self;
        let targets = if *num_targets > 0 { format!("-{num_targets}targets") } else { String::new() };
        format!("{side}-{}-{width}x{height}-{num_views}views{targets}{}-seed{seed}", scenes.kind(), scenes.name())
    }

    /// # Errors
    /// What is wrong, in words that name the key.
    pub(crate) fn check(&self) -> Result<(), String> {
        let kind = self.scenes.kind();
        let fault = |what: String| Err(format!("a source of kind {kind} {what}"));
        if self.width == 0 || self.height == 0 {
            return fault(format!("has width = {} and height = {}; both must be above 0", self.width, self.height));
        }
        if self.num_views < 2 {
            return fault(format!("has num_views = {}; the network needs at least 2", self.num_views));
        }
        match &self.scenes {
            Scenes::Re10k(clips) | Scenes::Acid(clips) => {
                let Clips { min_gap, max_gap, from, .. } = *clips;
                let wrong = |min_gap: usize, max_gap: usize| min_gap == 0 || min_gap > max_gap;
                match from {
                    _ if wrong(min_gap, max_gap) => fault(format!(
                        "has min_gap = {min_gap} and max_gap = {max_gap}; they must be 1 <= min_gap <= max_gap"
                    )),
                    Some(Beginning { min_gap, max_gap, .. }) if wrong(min_gap, max_gap) => fault(format!(
                        "has from.min_gap = {min_gap} and from.max_gap = {max_gap}; they must be 1 <= min_gap <= max_gap"
                    )),
                    _ => Ok(()),
                }
            }
            Scenes::Scans(Scans { turned_px, .. }) if !(0.0..=10.0).contains(turned_px) => {
                fault(format!("has turned_px = {turned_px}; it is 0 to 10 pixels"))
            }
            Scenes::Dtu(Dtu { light, .. }) if *light > 6 => fault(format!("has light = {light}; it is one of 0 to 6")),
            _ => Ok(()),
        }
    }
}
