//! The sets of photographs that a source can draw from, opened, as one numbered list of scenes.
//!
//! Between `surfel-data`, which reads each layout, and `photographed`, which draws. Invariant: the list has at least
//! one scene, and none that the paper's results are stated on is used for training or for choosing weights.

use super::config::{BlendedMvs, Clips, Dtu, Scenes};
use crate::error::TrainError;
use std::path::Path;
use surfel_data::blended_mvs::BlendedMvsSet;
use surfel_data::chunks::{ChunkOptions, ChunkSet};
use surfel_data::dtu::DtuSet;
use surfel_data::split::{DTU_TEST, DTU_TRAIN};
use surfel_data::{DataError, SceneViews};
use surfel_synth::Split;

/// An opened set.
pub(super) enum DataSet {
    /// RealEstate10K or ACID.
    Chunks { set: ChunkSet, keys: Vec<String> },
    /// DTU.
    Dtu { set: DtuSet, scans: Vec<u32> },
    /// BlendedMVS.
    BlendedMvs { set: BlendedMvsSet, names: Vec<String> },
}

impl DataSet {
    /// Opens a set for one side of the split; `None` for scenes that are rendered.
    ///
    /// # Errors
    /// [`TrainError::Layout`] when its folder is not laid out as it should be, or holds no scene of that side.
    pub(super) fn open(scenes: &Scenes, split: Split) -> Result<Option<Self>, TrainError> {
        let (opened, expected) = match scenes {
            Scenes::Scans(_) | Scenes::Analytic(_) => return Ok(None),
            Scenes::Re10k(clips) | Scenes::Acid(clips) => (
                Self::chunks(clips),
                "a folder with index.json and the chunks it lists, such as the set's folder train",
            ),
            Scenes::Dtu(dtu) => (Self::dtu(dtu, split), "the folder that holds Cameras, Rectified and Depths"),
            Scenes::BlendedMvs(blended) => {
                (Self::blended_mvs(blended), "the folder of scenes, each a folder with blended_images and cams")
            }
        };
        let folder = scenes.folder().unwrap_or(Path::new(""));
        let opened = opened.and_then(|set| match set.len() {
            0 => Err(DataError::Malformed { path: folder.to_owned(), reason: empty(scenes, split) }),
            _ => Ok(Some(set)),
        });
        opened.map_err(|source| TrainError::Layout { kind: scenes.kind(), expected, source: Box::new(source) })
    }

    fn chunks(clips: &Clips) -> Result<Self, DataError> {
        let set = ChunkSet::open(&clips.folder, ChunkOptions::CLIPS)?;
        let keys = set.keys().map(str::to_owned).collect();
        Ok(Self::Chunks { set, keys })
    }

    fn dtu(dtu: &Dtu, split: Split) -> Result<Self, DataError> {
        let set = DtuSet::open(&dtu.folder, dtu.light)?;
        let belongs = |scan: &u32| match split {
            Split::Train => DTU_TRAIN.contains(scan),
            Split::Val => !DTU_TRAIN.contains(scan) && !DTU_TEST.contains(scan),
        };
        let scans = set.scans()?.into_iter().filter(belongs).collect();
        Ok(Self::Dtu { set, scans })
    }

    fn blended_mvs(blended: &BlendedMvs) -> Result<Self, DataError> {
        let set = BlendedMvsSet::open(&blended.folder)?;
        let listed = blended.list.as_ref().map(|list| listed(&blended.folder.join(list))).transpose()?;
        let belongs = |name: &&str| listed.as_ref().is_none_or(|listed| listed.iter().any(|other| other == name));
        let names = set.names().filter(belongs).map(str::to_owned).collect();
        Ok(Self::BlendedMvs { set, names })
    }

    /// Number of scenes.
    pub(super) fn len(&self) -> usize {
        match self {
            Self::Chunks { keys, .. } => keys.len(),
            Self::Dtu { scans, .. } => scans.len(),
            Self::BlendedMvs { names, .. } => names.len(),
        }
    }

    /// Opens a scene for `look`.
    ///
    /// # Errors
    /// When its files are missing or damaged.
    pub(super) fn with_scene<T>(
        &self,
        index: usize,
        look: impl FnOnce(&mut dyn SceneViews) -> Result<T, DataError>,
    ) -> Result<T, DataError> {
        match self {
            Self::Chunks { set, keys } => {
                let (mut chunk, place) = set.chunk_of(&keys[index])?;
                look(&mut chunk.scene(place)?)
            }
            Self::Dtu { set, scans } => look(&mut set.scan(scans[index])?),
            Self::BlendedMvs { set, names } => look(&mut set.scene(&names[index])?),
        }
    }
}

/// Names in a text file, one a line.
fn listed(path: &Path) -> Result<Vec<String>, DataError> {
    let text = std::fs::read_to_string(path).map_err(|source| DataError::Read { path: path.to_owned(), source })?;
    Ok(text.split_whitespace().map(str::to_owned).collect())
}

/// Why a set that could be opened has no scene.
fn empty(scenes: &Scenes, split: Split) -> String {
    let reason = match (scenes, split) {
        (Scenes::Dtu(_), Split::Train) => {
            "holds no scan that is trained on (surfel_data::split::DTU_TRAIN), such as scan1_train"
        }
        (Scenes::Dtu(_), Split::Val) => {
            "holds no scan that is neither trained nor tested on, such as scan2_train; leave out [[validation]] of kind dtu"
        }
        _ => "holds none of the scenes that `list` names",
    };
    reason.to_owned()
}
