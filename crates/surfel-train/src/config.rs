//! The settings of a training run, read from TOML.
//!
//! Everything a run depends on is here. Invariant: an unknown key is an error, and the configuration is stored
//! with every checkpoint, so a resumed run cannot silently become another.

use crate::error::TrainError;
use crate::loss::LossWeights;
use crate::schedule::OneCycle;
use crate::source::SourceConfig;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// The network: TOML as in `surfel-net/presets`, or the name of a preset.
    pub network: String,
    /// Names the initial weights and the order of samples.
    pub seed: u64,
    /// Optimiser steps.
    pub steps: u64,
    /// Samples per step, whose gradients are averaged.
    pub batch: usize,
    /// Largest norm of all gradients together.
    pub clip: f64,
    /// Learning rate over the steps.
    pub rate: OneCycle,
    /// Parts of the network that learn, by the beginnings of their weights' names (`["head", "aggregation"]`); the
    /// others keep what they know. Empty: all of it learns.
    #[serde(default)]
    pub learns: Vec<String>,
    /// Weights that are measured and kept are means over about `1 / (1 - averaging)` steps; 0 = the last ones.
    #[serde(default)]
    pub averaging: f64,
    /// Weights of the loss.
    pub loss: LossWeights,
    /// Samples to learn from; the first `num_samples` of each source, in an order drawn anew every epoch.
    pub train: Vec<SourceEntry>,
    /// Samples to measure on, from the validation side of the assets.
    pub validation: Vec<SourceEntry>,
    /// When to log, measure and save.
    pub every: Intervals,
}

/// A source and how many of its samples are used. Keys that are unknown here and to every source are refused by the
/// kind of source, the last to be asked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SourceEntry {
    /// How many.
    pub num_samples: u64,
    /// The source.
    #[serde(flatten)]
    pub source: SourceConfig,
}

/// Steps between things.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Intervals {
    /// A line of `metrics.jsonl`.
    pub log: u64,
    /// Validation.
    pub validate: u64,
    /// A checkpoint.
    pub checkpoint: u64,
    /// A picture of the first validation sample; 0 = never.
    #[serde(default)]
    pub pictures: u64,
}

impl TrainConfig {
    /// Reads and checks a configuration.
    ///
    /// # Errors
    /// [`TrainError::Config`] with the key at fault.
    pub fn from_file(path: &Path) -> Result<Self, TrainError> {
        let text = std::fs::read_to_string(path).map_err(TrainError::unreadable(path))?;
        Self::from_toml(&text).map_err(|reason| TrainError::Config { path: path.to_path_buf(), reason })
    }

    /// Reads and checks a configuration.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub fn from_toml(text: &str) -> Result<Self, String> {
        let config: Self = toml::from_str(text).map_err(|error| error.to_string())?;
        config.network()?;
        let positive = [
            ("steps", config.steps > 0),
            ("batch", config.batch > 0),
            ("clip", config.clip > 0.0),
            ("rate.rate", config.rate.rate > 0.0),
            ("1 - averaging", config.averaging < 1.0),
            ("every.log", config.every.log > 0),
            ("every.validate", config.every.validate > 0),
            ("every.checkpoint", config.every.checkpoint > 0),
            ("train (its num_samples)", config.num_samples() > 0),
        ];
        let checked = match positive.iter().find(|(_, ok)| !ok) {
            Some((key, _)) => Err(format!("{key} must be above 0")),
            None => config.train.iter().chain(&config.validation).try_for_each(|entry| entry.source.check()),
        };
        checked.map(|()| config)
    }

    /// The network's settings.
    ///
    /// # Errors
    /// What is wrong with them, in words.
    pub fn network(&self) -> Result<surfel_net::NetConfig, String> {
        use surfel_net::{NetConfig, Preset};
        match self.network.as_str() {
            "paper" => Ok(NetConfig::preset(Preset::Paper)),
            "small" => Ok(NetConfig::preset(Preset::Small)),
            "narrow" => Ok(NetConfig::preset(Preset::Narrow)),
            "tiny" => Ok(NetConfig::preset(Preset::Tiny)),
            text => NetConfig::from_toml(text).map_err(|error| format!("network: {error}")),
        }
    }

    /// Samples of one epoch.
    pub fn num_samples(&self) -> u64 {
        self.train.iter().map(|entry| entry.num_samples).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::Scenes;

    #[test]
    fn the_configurations_that_come_along_can_be_used() {
        let depth = TrainConfig::from_toml(include_str!("../configs/small_stage1.toml")).unwrap();
        let surfels = TrainConfig::from_toml(include_str!("../configs/small_stage2.toml")).unwrap();
        let views = TrainConfig::from_toml(include_str!("../configs/small_views.toml")).unwrap();
        let streets = TrainConfig::from_toml(include_str!("../configs/small_streets.toml")).unwrap();
        let card = TrainConfig::from_toml(include_str!("../configs/small_card.toml")).unwrap();
        let rooms = TrainConfig::from_toml(include_str!("../configs/small_rooms.toml")).unwrap();
        assert!([&depth, &views, &streets, &card, &rooms].iter().all(|config| !config.loss.needs_surfels()));
        assert!(surfels.loss.needs_surfels() && views.train.iter().any(|entry| entry.source.num_views == 4));
        let is_street = |scenes: &Scenes| matches!(scenes, Scenes::Scans(scans) if scans.street_share > 0.0);
        assert!(streets.train.iter().any(|entry| is_street(&entry.source.scenes)));
        let misspelt = include_str!("../configs/small_stage1.toml").replace("plane_normal", "plain_normal");
        assert!(TrainConfig::from_toml(&misspelt).unwrap_err().contains("plain_normal"));
    }

    #[test]
    fn the_papers_stages_train_its_network_on_what_each_set_knows() {
        use surfel_net::{NetConfig, Preset};
        let stage = |text: &str| TrainConfig::from_toml(text).unwrap();
        let stages = [include_str!("../configs/stage1.toml"), include_str!("../configs/stage2.toml")].map(stage);
        for stage in &stages {
            assert_eq!(stage.network().unwrap(), NetConfig::preset(Preset::Paper));
            let sources = stage.train.iter().chain(&stage.validation).map(|entry| &entry.source);
            sources.for_each(|source| assert!(source.num_views == 2 && source.num_targets > 0));
        }
        let [first, second] = stages;
        let kinds = [&first, &second].map(|stage| stage.train[0].source.scenes.kind());
        assert_eq!((kinds, first.steps, second.steps), (["re10k", "dtu"], 300_000, 2_000));
        let alignment = |step| first.loss.at(step).rendered.alignment;
        assert!(alignment(19_999) == 0.0 && alignment(20_000) > 0.0);
        assert!(first.loss.range_depth == 0.0 && second.loss.range_depth > 0.0);
        assert!(second.loss.at(0).rendered.alignment > 0.0);
        assert!(first.loss.rendered.context == 0.0 && second.loss.rendered.context == 1.0);
        // No sample of the first stage comes twice.
        assert_eq!(first.num_samples(), first.steps * first.batch as u64);
    }

    /// A configuration whose first source is another.
    fn with_source(source: &str) -> Result<TrainConfig, String> {
        let text = include_str!("../configs/small_stage1.toml");
        let first = text.find("[[train]]").expect("a source");
        let size = "num_samples = 5\nseed = 1\nwidth = 64\nheight = 48";
        TrainConfig::from_toml(&format!("{}[[train]]\n{size}\n{source}\n{}", &text[..first], &text[first..]))
    }

    #[test]
    fn every_kind_of_source_knows_its_own_keys_only() {
        let re10k = "num_views = 2\nkind = \"re10k\"\nfolder = \"set\"\nmin_gap = 20\nmax_gap = 40";
        let config = with_source(re10k).unwrap();
        assert_eq!(TrainConfig::from_toml(&toml::to_string(&config).unwrap()).unwrap(), config);
        let refused = |source: &str, words: &[&str]| {
            let error = with_source(source).unwrap_err();
            words.iter().for_each(|words| assert!(error.contains(words), "{words:?} is not in: {error}"));
        };
        refused(&format!("{re10k}\nroom_share = 0.1"), &["room_share", "expected", "min_gap"]);
        refused("num_views = 2\nkind = \"scans\"\nroom_share = 0.1\nfolder = \"set\"", &["`folder`", "pair_angle_deg"]);
        refused("num_views = 2\nkind = \"analytic\"\nlight = 3", &["`light`"]);
        refused("num_views = 2\nkind = \"dtu\"\nfolder = \"set\"\nmin_gap = 1", &["`min_gap`", "`light`"]);
        refused("num_views = 2\nkind = \"re10k\"\nmin_gap = 1\nmax_gap = 2", &["folder"]);
        refused("num_views = 2\nkind = \"film\"", &["film", "blended_mvs"]);
        refused(&re10k.replace("20", "50"), &["re10k", "min_gap = 50 and max_gap = 40"]);
        refused(&re10k.replace("num_views = 2", "num_views = 1"), &["num_views = 1", "at least 2"]);
        refused("num_views = 2\nkind = \"dtu\"\nfolder = \"set\"\nlight = 7", &["light = 7", "0 to 6"]);
    }
}
