//! A posed scene: photographs with cameras, whatever the format they came in.
//!
//! `detect` finds the camera file, a module of `formats` reads it, `matching` joins it with the images on
//! disk. Everything past this module sees continuous pixel coordinates, OpenCV axes and
//! `camera_from_world`. Invariant: a [`Scene`] has at least two frames, and each frame's intrinsics are for
//! the pixels of its own image file.

mod calibration;
mod detect;
mod entry;
mod error;
mod files;
mod format;
mod formats;
mod matching;
mod select;
mod tokens;

pub use error::SceneError;
pub use format::{FormatKind, SceneFormat, list_formats};
pub use formats::mvsnet::{CamText, read_cam_text};

use glam::DVec3;
use image::metadata::Orientation;
use std::path::{Path, PathBuf};
use surfel_core::{Intrinsics, Lens, Rigid};

/// Photographs with their cameras.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The folder everything is relative to.
    pub root: PathBuf,
    /// Which cameras were found; say it aloud.
    pub format: SceneFormat,
    /// The photographs, in the order of the camera file (COLMAP: sorted by name).
    pub frames: Vec<Frame>,
    /// Sparse points, world frame, scene units; empty for most formats.
    pub points: Vec<SparsePoint>,
    /// What had to be assumed or left out; say it aloud too.
    pub warnings: Vec<String>,
}

/// One photograph and its camera, before its pixels are read.
#[derive(Clone, Debug)]
pub struct Frame {
    /// As the camera file names it.
    pub name: String,
    /// The image file.
    pub image_path: PathBuf,
    /// The mask file: white shows what to reconstruct.
    pub mask_path: Option<PathBuf>,
    /// Image columns that the intrinsics are for (after `orientation`).
    pub width: usize,
    /// Image rows that the intrinsics are for (after `orientation`).
    pub height: usize,
    /// Continuous pixel coordinates of a `width` x `height` image.
    pub intrinsics: Intrinsics,
    /// Distortion, in normalised coordinates.
    pub lens: Lens,
    /// World to camera, OpenCV axes, scene units.
    pub camera_from_world: Rigid,
    /// Depth range stated by the camera file, scene units.
    pub near_far: Option<(f64, f64)>,
    /// How the stored pixels are turned before the intrinsics hold; nearly always not at all.
    pub orientation: Orientation,
}

impl Frame {
    /// The image's file name without folder and extension; names outputs.
    pub fn stem(&self) -> String {
        files::stem_of(&self.image_path)
    }
}

/// A point of a sparse reconstruction.
#[derive(Clone, Debug, PartialEq)]
pub struct SparsePoint {
    /// World frame, scene units.
    pub position: DVec3,
    /// Indices of the frames that see it, ascending.
    pub seen_by: Vec<u32>,
}

impl Scene {
    /// Opens a scene folder, or the camera file in one, of any known format.
    ///
    /// # Errors
    /// [`SceneError`]: no cameras, several scenes, a damaged camera file, images that do not fit.
    pub fn open(path: &Path) -> Result<Self, SceneError> {
        Self::open_detected(detect::detect(path, None)?)
    }

    /// Opens a scene whose format is known.
    ///
    /// # Errors
    /// As [`Scene::open`], and [`SceneError::NotThisFormat`].
    pub fn open_as(path: &Path, kind: FormatKind) -> Result<Self, SceneError> {
        Self::open_detected(detect::detect(path, Some(kind))?)
    }

    fn open_detected(detection: detect::Detection) -> Result<Self, SceneError> {
        let detect::Detection { root, candidates, mut warnings } = detection;
        let (chosen, others) = candidates.split_first().ok_or_else(|| SceneError::NoCameras { path: root.clone() })?;
        let cameras = formats::read(chosen.kind, &chosen.source)?;
        let dialect = cameras.dialect;
        let relative = |path: &Path| path.strip_prefix(&root).unwrap_or(path).to_owned();
        if !others.is_empty() {
            let names: Vec<String> = others.iter().map(|other| described(other, &relative(&other.source))).collect();
            warnings.push(format!(
                "{} also holds {}; taken is {}",
                root.display(),
                names.join(", "),
                described(chosen, &relative(&chosen.source))
            ));
        }
        let matched = matching::match_photographs(&root, &chosen.source, cameras)?;
        warnings.extend(matched.warnings);
        let format = SceneFormat {
            kind: chosen.kind,
            dialect,
            source: relative(&chosen.source),
            num_images: matched.frames.len(),
            num_cameras: num_cameras(&matched.frames),
        };
        Ok(Self { root, format, frames: matched.frames, points: matched.points, warnings })
    }
}

fn described(candidate: &detect::Candidate, source: &Path) -> String {
    format!("{} ({})", source.display(), candidate.kind)
}

/// Different intrinsics; those of one camera differ by rounding where they come from projection matrices.
fn num_cameras(frames: &[Frame]) -> usize {
    let mut different: Vec<&Frame> = Vec::new();
    for frame in frames {
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-3 * frame.width as f64;
        let same = |other: &&&Frame| {
            let (k, l) = (frame.intrinsics, other.intrinsics);
            let same_size = (frame.width, frame.height, frame.lens) == (other.width, other.height, other.lens);
            same_size && close(k.fx, l.fx) && close(k.fy, l.fy) && close(k.cx, l.cx) && close(k.cy, l.cy)
        };
        if !different.iter().any(|other| same(&other)) {
            different.push(frame);
        }
    }
    different.len()
}
