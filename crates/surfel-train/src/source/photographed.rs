//! Samples of photographed scenes: which scene, which of its views, and what is known of them.
//!
//! Scenes are drawn until one can be used: clips may be shorter than the gap asked for, and some have cameras that no
//! network should see (spec 4.5, 4.6). Invariant: the same random numbers give the same sample.

use super::config::{Scenes, SourceConfig};
use super::data_set::DataSet;
use crate::error::TrainError;
use crate::sample::{Sample, Target};
use crate::truth::{Hole, TrueDepth, ViewTruth};
use std::path::Path;
use surfel_core::{Grid, View};
use surfel_data::choice::{Choice, GapChooser, PairChooser};
use surfel_data::{DataError, SceneViews, TrainingScene, TrainingView, load};
use surfel_net::DepthRange;
use surfel_synth::Random;

/// Scenes drawn for one sample before it is given up.
const MOST_DRAWS: usize = 64;
/// Targets of a pair list are drawn from this many sources after the contexts.
const NEXT_SOURCES: usize = 8;
/// Shortest baseline in nearest depths; below it two frames show the same.
const LEAST_BASELINE: f64 = 1e-4;

/// Photographs to draw samples from.
pub(super) struct Photographed {
    set: DataSet,
    chooser: Chooser,
}

/// How views are chosen.
enum Chooser {
    Gap(GapChooser),
    Pairs(PairChooser),
}

/// A scene that was drawn, or why it cannot be used.
type Drawn = Result<TrainingScene, String>;

impl Photographed {
    /// Choosing from `set` as `config` says.
    pub(super) fn new(set: DataSet, config: &SourceConfig) -> Self {
        let (num_contexts, num_targets) = (config.num_views, config.num_targets);
        let chooser = match &config.scenes {
            Scenes::Re10k(clips) | Scenes::Acid(clips) => {
                let [min_gap, max_gap] = clips.gaps();
                Chooser::Gap(GapChooser { num_contexts, min_gap, max_gap, margin: 0, num_targets })
            }
            _ => Chooser::Pairs(PairChooser { num_contexts, num_targets, among: NEXT_SOURCES }),
        };
        Self { set, chooser }
    }

    /// Draws a scene and views of it for the sample with a number; they are not matched yet.
    ///
    /// # Errors
    /// [`TrainError::NoUsableScene`] when none that was drawn can be used, [`TrainError::Data`] for a file that is
    /// missing or damaged.
    pub(super) fn sample(&self, config: &SourceConfig, number: u64, random: &mut Random) -> Result<Sample, TrainError> {
        let number = usize::try_from(number).unwrap_or(usize::MAX);
        let mut reason = String::new();
        for _ in 0..MOST_DRAWS {
            let index = random.below(self.set.len());
            match self.set.with_scene(index, |scene| self.draw(scene, config, number, random))? {
                Ok(scene) => return Ok(sample_of(scene)),
                Err(unusable) => reason = unusable,
            }
        }
        let folder = config.scenes.folder().map(Path::to_owned).unwrap_or_default();
        Err(TrainError::NoUsableScene { folder, draws: MOST_DRAWS, reason })
    }

    fn draw(
        &self,
        scene: &mut dyn SceneViews,
        config: &SourceConfig,
        number: usize,
        random: &mut Random,
    ) -> Result<Drawn, DataError> {
        let num_views = scene.num_views();
        let choice = match &self.chooser {
            Chooser::Gap(chooser) => chooser.choose(num_views, number, random),
            Chooser::Pairs(chooser) => scene.pairs().and_then(|pairs| chooser.choose(pairs, num_views, random)),
        };
        let Some(choice) = choice else { return Ok(Err(self.too_few(scene, number))) };
        match load(scene, &choice, config.width, config.height) {
            Ok(scene) => Ok(parallax(scene, &choice)),
            Err(error @ DataError::TooWide { .. }) => Ok(Err(error.to_string())),
            Err(error) => Err(error),
        }
    }

    fn too_few(&self, scene: &dyn SceneViews, number: usize) -> String {
        let (name, num_views) = (scene.name(), scene.num_views());
        match &self.chooser {
            Chooser::Gap(GapChooser { num_contexts, min_gap, num_targets, .. }) => format!(
                "{name} has {num_views} frames, too few for {num_contexts} views over a gap of {} with {num_targets} targets between; lower min_gap or num_targets, or add longer clips",
                min_gap.at(number)
            ),
            Chooser::Pairs(PairChooser { num_contexts, num_targets, .. }) => format!(
                "no view of {name} has enough sources in pair.txt among its {num_views} cameras for {num_contexts} views and {num_targets} targets; lower num_views or num_targets, or complete pair.txt and cams"
            ),
        }
    }
}

/// The scene, if its contexts were taken from different places.
fn parallax(scene: TrainingScene, choice: &Choice) -> Drawn {
    let centre = |view: &TrainingView| view.camera.centre();
    let baselines = scene.contexts.windows(2).map(|pair| centre(&pair[0]).distance(centre(&pair[1])));
    match baselines.fold(f64::INFINITY, f64::min) < LEAST_BASELINE * scene.near {
        true => Err(format!("views {:?} of {} were taken from one place; raise min_gap", choice.contexts, scene.name)),
        false => Ok(scene),
    }
}

fn sample_of(scene: TrainingScene) -> Sample {
    let TrainingScene { contexts, targets, near, far, .. } = scene;
    let range = DepthRange { near, far };
    let (views, truth) = contexts.into_iter().map(split).unzip();
    let target = |view| {
        let (view, truth) = split(view);
        Target::new(view, range, truth)
    };
    Sample { targets: targets.into_iter().map(target).collect(), ..Sample::new(views, range, truth) }
}

/// The photograph, and what is known of it: where the set does not trust its truth, nothing is.
fn split(view: TrainingView) -> (View, ViewTruth) {
    let TrainingView { name, image, camera, depth, normal, mask } = view;
    let trusted = |x: usize, y: usize| mask.as_ref().is_none_or(|mask| mask[(x, y)]);
    let depth = depth.map(|map| {
        let map = Grid::from_fn(map.width(), map.height(), |x, y| if trusted(x, y) { map[(x, y)] } else { 0.0 });
        TrueDepth { map, hole: Hole::Unmeasured }
    });
    let normal = normal
        .map(|map| Grid::from_fn(map.width(), map.height(), |x, y| if trusted(x, y) { map[(x, y)] } else { [0.0; 3] }));
    (View::new(name, image, camera), ViewTruth { depth, normal, object: None })
}
