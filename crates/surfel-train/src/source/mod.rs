//! Where samples come from: one number, one sample.
//!
//! Rendered scans (`surfel-synth`, a folder of assets), analytic scenes (nothing needed), or photographs of the
//! paper's training sets (`surfel-data`). Invariant: a sample depends on the source's settings, its files and its
//! number alone, so any sample can be made again, in any order.

mod config;
mod data_set;
mod photographed;
mod rendered;

pub use config::{Analytic, BlendedMvs, Clips, Dtu, Scans, Scenes, SourceConfig};

use crate::error::TrainError;
use crate::sample::Sample;
use data_set::DataSet;
use photographed::Photographed;
use std::path::Path;
use surfel_synth::{AssetLibrary, Random, Split};

/// A source, opened for one side of the split.
pub struct Source {
    config: SourceConfig,
    opened: Opened,
}

enum Opened {
    Scans(Scans, Box<AssetLibrary>),
    Analytic,
    Photographed(Photographed),
}

impl Source {
    /// Opens one side of the assets or of the set; analytic scenes need neither.
    ///
    /// # Errors
    /// [`TrainError::NoAssets`] when there are none, [`TrainError::Assets`] when their folder lacks something,
    /// [`TrainError::Layout`] when the folder of a set does.
    pub fn open(config: &SourceConfig, split: Split, assets: Option<&Path>) -> Result<Self, TrainError> {
        let opened = match (DataSet::open(&config.scenes, split)?, &config.scenes) {
            (Some(set), _) => Opened::Photographed(Photographed::new(set, config)),
            (None, Scenes::Scans(scans)) => {
                let folder = assets.ok_or(TrainError::NoAssets)?;
                Opened::Scans(scans.clone(), Box::new(AssetLibrary::open(folder, split)?))
            }
            (None, _) => Opened::Analytic,
        };
        Ok(Self { config: config.clone(), opened })
    }

    /// The sample with a number.
    ///
    /// # Errors
    /// When a file cannot be read, the scene shows nothing, or no scene of a set has enough views.
    pub fn sample(&self, number: u64) -> Result<Sample, TrainError> {
        let mut random = Random::fork(self.config.seed, number);
        let seed = random.bits();
        let rendered = match &self.opened {
            Opened::Photographed(photographed) => return photographed.sample(&self.config, &mut random),
            Opened::Scans(scans, library) => rendered::scans(library, &self.config, scans, seed)?,
            Opened::Analytic => rendered::analytic(&self.config, seed, &mut random),
        };
        Sample::of(&rendered, &mut random)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Settings of small analytic pairs.
    pub(crate) fn config(seed: u64) -> SourceConfig {
        SourceConfig { seed, width: 48, height: 32, num_views: 2, scenes: Scenes::Analytic(Analytic {}) }
    }

    /// The first of them.
    pub(crate) fn analytic(seed: u64) -> Sample {
        Source::open(&config(seed), Split::Train, None).unwrap().sample(0).unwrap()
    }
}
