//! Which rendered scenes: the flags that `synth` and the experiments share.
//!
//! Invariant: parsing opens no file; [`SceneArgs::source`] does.

use anyhow::Result;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use surfel_synth::{AssetLibrary, SceneKind, SceneOptions, SceneSource, Split, SynthConfig};

/// Side of the train/val split of the scanned objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SplitName {
    /// Objects to learn from.
    Train,
    /// Objects to measure on.
    Val,
}

/// What scanned objects stand in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum World {
    /// A few objects on a table, cameras on an arc as DTU has them.
    Tabletop,
    /// A furnished room, a camera that walks.
    Room,
    /// Buildings under an open sky, a camera that walks past.
    Street,
    /// Three tabletops for each room.
    Mixed,
}

/// Rendered scenes, named by seeds.
#[derive(Debug, Args)]
pub struct SceneArgs {
    /// Folder of scanned objects with split.json, meshes/, textures/ and envmaps/ (default: analytic scenes).
    #[arg(long, value_name = "DIR")]
    pub assets: Option<PathBuf>,

    /// Which scanned objects.
    #[arg(long, value_enum, default_value_t = SplitName::Val, requires = "assets")]
    pub split: SplitName,

    /// What the scanned objects stand in.
    #[arg(long, value_enum, default_value_t = World::Tabletop, requires = "assets")]
    pub world: World,

    /// Analytic shapes, one per seed in turn (default: all six).
    #[arg(long, value_name = "KIND,...", value_delimiter = ',', conflicts_with = "assets", value_parser = parse_kind)]
    pub kind: Vec<SceneKind>,

    /// Scenes by number: 7, 0..8 (8 excluded) or 1,4,9.
    #[arg(long, value_name = "SEEDS", default_value = "0..4", value_parser = parse_seeds)]
    pub seeds: Seeds,

    /// Photographs per scene.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = at_least_two)]
    pub views_per_scene: usize,

    /// Photographs as a real camera takes them: noise, exposure and white balance that change between views, JPEG,
    /// pair angles of 5 to 30 degrees (default: flawless, 11 degrees).
    #[arg(long)]
    pub defects: bool,
}

/// A list of seeds that can be typed.
#[derive(Clone, Debug, PartialEq)]
pub struct Seeds(pub Vec<u64>);

/// Noise of an analytic scene with defects, sRGB units.
const ANALYTIC_NOISE: f32 = 0.01;

impl SceneArgs {
    /// How many times wider than on a tabletop a pixel is on what these scenes show: the factor of every length that is
    /// not given on the command line.
    pub fn magnification(&self) -> f64 {
        match self.world {
            World::Tabletop | World::Mixed => 1.0,
            World::Room => 10.0,
            World::Street => 40.0,
        }
    }

    /// Opens the source of these scenes at a picture size.
    pub fn source(&self, (width, height): (usize, usize)) -> Result<SceneSource> {
        let Some(folder) = &self.assets else {
            let kinds = if self.kind.is_empty() { SceneKind::ALL.to_vec() } else { self.kind.clone() };
            let noise = if self.defects { ANALYTIC_NOISE } else { 0.0 };
            let num_views = self.views_per_scene;
            let options = SceneOptions { width, height, num_views, noise, ..SceneOptions::default() };
            return Ok(SceneSource::Analytic { kinds, options });
        };
        let split = match self.split {
            SplitName::Train => Split::Train,
            SplitName::Val => Split::Val,
        };
        let usual = SynthConfig::default();
        let (room_share, street_share) = match self.world {
            World::Tabletop => (0.0, 0.0),
            World::Room => (1.0, 0.0),
            World::Street => (0.0, 1.0),
            World::Mixed => (usual.room_share, usual.street_share),
        };
        let config =
            if self.defects { SynthConfig { width, height, ..usual } } else { SynthConfig::clean_pair(width, height) };
        let config = SynthConfig { room_share, street_share, num_views: self.views_per_scene, ..config };
        Ok(SceneSource::Scanned { library: Box::new(AssetLibrary::open(folder, split)?), split, config })
    }

    /// These scenes in words, for a report.
    pub fn describe(&self) -> String {
        let views = self.views_per_scene;
        let camera = if self.defects { "with camera defects" } else { "without camera defects" };
        let seeds = self.seeds.describe();
        if self.assets.is_none() {
            let kinds: Vec<&str> = match self.kind.as_slice() {
                [] => SceneKind::ALL.map(SceneKind::name).to_vec(),
                some => some.iter().map(|kind| kind.name()).collect(),
            };
            return format!("analytic ({}), seeds {seeds}, {views} views each, {camera}", kinds.join(", "));
        }
        let name =
            |value: Option<clap::builder::PossibleValue>| value.map_or_else(String::new, |v| v.get_name().to_owned());
        format!(
            "scanned objects of the {} split, {}, seeds {seeds}, {views} views each, {camera}",
            name(self.split.to_possible_value()),
            name(self.world.to_possible_value()),
        )
    }
}

impl Seeds {
    /// "0..8" for a run of seeds, else the list.
    fn describe(&self) -> String {
        match (self.0.first(), self.0.last()) {
            (Some(&first), Some(&last)) if self.0.len() > 2 && self.0.iter().copied().eq(first..=last) => {
                format!("{first}..{}", last + 1)
            }
            _ => self.0.iter().map(u64::to_string).collect::<Vec<_>>().join(","),
        }
    }
}

/// More scenes than this in one run are a slip of the finger.
const MAX_SEEDS: u64 = 1_000_000;

fn parse_seeds(text: &str) -> Result<Seeds, String> {
    let wrong = || "must be a number, a range such as 0..8, or a list such as 1,4,9".to_owned();
    let number = |text: &str| text.trim().parse::<u64>().map_err(|_| wrong());
    if let Some((first, end)) = text.split_once("..") {
        let (first, end) = (number(first)?, number(end)?);
        if end <= first || end - first > MAX_SEEDS {
            return Err(format!("{text} holds no scene, or more than {MAX_SEEDS}"));
        }
        return Ok(Seeds((first..end).collect()));
    }
    text.split(',').map(number).collect::<Result<_, _>>().map(Seeds)
}

fn parse_kind(text: &str) -> Result<SceneKind, String> {
    SceneKind::ALL.into_iter().find(|kind| kind.name() == text).ok_or_else(|| {
        let names = SceneKind::ALL.map(SceneKind::name).join(", ");
        format!("is none of {names}")
    })
}

fn at_least_two(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&n| n >= 2).ok_or_else(|| "must be a whole number of at least 2".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_as_people_type_them() {
        assert_eq!(parse_seeds("7"), Ok(Seeds(vec![7])));
        assert_eq!(parse_seeds("2..5"), Ok(Seeds(vec![2, 3, 4])));
        assert_eq!(parse_seeds("1, 9"), Ok(Seeds(vec![1, 9])));
        for wrong in ["", "a", "5..5", "9..2", "0..99999999999", "-1"] {
            assert!(parse_seeds(wrong).is_err(), "{wrong}");
        }
        assert_eq!(
            (parse_seeds("2..5").unwrap().describe(), parse_seeds("1,9").unwrap().describe()),
            ("2..5".into(), "1,9".into())
        );
    }
}
