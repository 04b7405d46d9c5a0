//! Where samples come from: one number, one sample.
//!
//! Rendered scans (`surfel-synth`, a folder of assets), analytic scenes (nothing needed), or photographs of the
//! paper's training sets (`surfel-data`). Invariant: a sample depends on the source's settings, its files and its
//! number alone, so any sample can be made again, in any order.

mod config;
mod data_set;
mod photographed;
mod rendered;
mod turned;

pub use config::{Analytic, Beginning, BlendedMvs, Clips, Dtu, Scans, Scenes, SourceConfig};

use crate::error::TrainError;
use crate::sample::Sample;
use data_set::DataSet;
use photographed::Photographed;
use std::path::Path;
use surfel_synth::{AssetLibrary, Random, RenderedView, Split};

/// A source, opened for one side of the split.
pub struct Source {
    config: SourceConfig,
    opened: Opened,
    matching: bool,
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
        Ok(Self { config: config.clone(), opened, matching: true })
    }

    /// The source without what matching finds, which only some networks ask for and which takes most of the time.
    #[must_use]
    pub fn without_matching(self) -> Self {
        Self { matching: false, ..self }
    }

    /// What tells its samples from those of other sources, as the name of a folder.
    pub(crate) fn folder_name(&self, side: &str) -> String {
        let matching = if self.matching { format!("matching{}", surfel_stereo::EDITION) } else { "unmatched".into() };
        format!("{}-{matching}", self.config.folder_name(side))
    }

    /// Whether samples grow harder with their numbers.
    pub(crate) fn grows(&self) -> bool {
        self.config.scenes.grow()
    }

    /// The sample with a number.
    ///
    /// # Errors
    /// When a file cannot be read, the scene shows nothing, or no scene of a set has enough views.
    pub fn sample(&self, number: u64) -> Result<Sample, TrainError> {
        let mut random = Random::fork(self.config.seed, number);
        let seed = random.bits();
        let rendered = |views: Vec<RenderedView>, random: &mut Random| {
            let (given, held_out) = views.split_at(self.config.num_views);
            Sample::of(given, held_out, random)
        };
        let sample = match &self.opened {
            Opened::Photographed(photographed) => photographed.sample(&self.config, number, &mut random),
            Opened::Scans(scans, library) => {
                rendered(rendered::scans(library, &self.config, scans, seed)?, &mut random)
            }
            Opened::Analytic => rendered(rendered::analytic(&self.config, seed, &mut random), &mut random),
        };
        if self.matching { sample?.matched() } else { sample }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use surfel_core::Camera;

    /// Settings of small analytic pairs.
    pub(crate) fn config(seed: u64) -> SourceConfig {
        let (width, height, scenes) = (48, 32, Scenes::Analytic(Analytic {}));
        SourceConfig { seed, width, height, num_views: 2, num_targets: 0, scenes }
    }

    /// The first of them.
    pub(crate) fn analytic(seed: u64) -> Sample {
        Source::open(&config(seed), Split::Train, None).unwrap().sample(0).unwrap()
    }

    /// The first with views held out.
    pub(crate) fn with_targets(seed: u64, num_targets: usize) -> Sample {
        let config = SourceConfig { num_targets, ..config(seed) };
        Source::open(&config, Split::Train, None).unwrap().sample(0).unwrap()
    }

    #[test]
    fn views_held_out_show_the_same_surface_from_elsewhere_and_change_nothing_else() {
        let (without, with) = (analytic(4), with_targets(4, 3));
        assert_eq!((&with.images, &with.truth, &with.ranges), (&without.images, &without.truth, &without.ranges));
        assert_eq!((with.targets.len(), without.targets.len()), (3, 0));
        let (width, _) = with.size();
        for target in &with.targets {
            let centres = with.cameras.iter().map(|camera| camera.centre());
            assert!(centres.into_iter().all(|centre| centre.distance(target.camera.centre()) > 1.0));
            // What the first view sees, the target sees in the same place, unless something else is in the way.
            let (mut seen, mut same) = (0, 0);
            for i in 0..with.num_pixels() {
                let pixel = Camera::pixel_centre(i % width, i / width);
                let point = with.cameras[0].unproject(pixel, f64::from(with.truth[0].depth_at(i)));
                let Some((at, depth)) = target.camera.project(point) else { continue };
                if at.min_element() > 0.0 && at.x < 48.0 && at.y < 32.0 {
                    let truth = target.truth.depth_at(at.y as usize * width + at.x as usize);
                    seen += 1;
                    same += usize::from((f64::from(truth) / depth - 1.0).abs() < 0.03);
                }
            }
            assert!(seen > 800 && same > 7 * seen / 10, "{same} of {seen}");
        }
    }

    #[test]
    fn without_matching_only_its_answer_is_missing() {
        let open = || Source::open(&config(5), Split::Train, None).unwrap();
        let (matched, unmatched) = (open().sample(2).unwrap(), open().without_matching().sample(2).unwrap());
        assert_eq!(
            (&unmatched.images, &unmatched.truth, &unmatched.ranges),
            (&matched.images, &matched.truth, &matched.ranges)
        );
        assert!(unmatched.seeds.is_empty() && matched.seeds.len() == 2);
        for (own, of_matching) in unmatched.steps().iter().zip(matched.steps()) {
            assert!((0.5..2.0).contains(&(own / of_matching)), "{own} and {of_matching}");
        }
        assert_ne!(open().folder_name("train"), open().without_matching().folder_name("train"));
    }
}
