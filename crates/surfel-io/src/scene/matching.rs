//! Joins what a camera file says with the photographs on disk: entries become frames.
//!
//! Missing photographs are dropped with a warning; fewer than two left is an error. Only image headers are
//! read. Invariant: every frame's intrinsics are for the pixels of its own image file.

use super::calibration::{self, Resolved, Unexplained};
use super::entry::{Calibration, CameraFile, Entry, ImageKey};
use super::error::SceneError;
use super::files::ImageFiles;
use super::{Frame, SparsePoint};
use crate::photo;
use glam::DVec2;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use surfel_core::Lens;

/// Frames, points and warnings of a scene.
pub(super) struct Matched {
    pub frames: Vec<Frame>,
    pub points: Vec<SparsePoint>,
    pub warnings: Vec<String>,
}

/// Finds the photographs of `cameras` (read from `source`) below `root`.
pub(super) fn match_photographs(root: &Path, source: &Path, cameras: CameraFile) -> Result<Matched, SceneError> {
    let files = ImageFiles::below(root)?;
    let mut notes = Notes::default();
    let paths = find_images(&files, &cameras.entries, &mut notes);
    let headers: Vec<Option<Result<photo::Header, photo::ImageError>>> =
        paths.par_iter().map(|path| path.as_ref().map(|path| photo::read_header(&root.join(path)))).collect();
    let stated = cameras.entries.len();
    let mut frames = Vec::new();
    let mut frame_of_entry = vec![None; stated];
    let mut missing = Vec::new();
    for (index, ((entry, path), header)) in cameras.entries.into_iter().zip(paths).zip(headers).enumerate() {
        let (Some(path), Some(header)) = (path, header) else {
            missing.push(entry.name);
            continue;
        };
        let header = match header {
            Ok(header) => header,
            Err(error) => {
                missing.push(format!("{} ({error})", entry.name));
                continue;
            }
        };
        frame_of_entry[index] = Some(frames.len() as u32);
        frames.push(frame(root, source, entry, &path, header, &files, &mut notes)?);
    }
    if frames.len() < 2 {
        return Err(too_few(root, source, frames.len(), stated, &missing, &files));
    }
    if !missing.is_empty() {
        notes.add(format!(
            "{} of {stated} photographs are missing and left out: {}",
            missing.len(),
            abbreviated(&missing)
        ));
    }
    let keep = |seen_by: Vec<u32>| seen_by.into_iter().filter_map(|entry| frame_of_entry[entry as usize]).collect();
    let points = cameras.points.into_iter().map(|(position, seen_by)| SparsePoint { position, seen_by: keep(seen_by) });
    let mut warnings = cameras.warnings;
    warnings.extend(notes.into_warnings(frames.len()));
    Ok(Matched { frames, points: points.collect(), warnings })
}

/// Uses the kind of key that finds most images; of equals, the first.
fn find_images(files: &ImageFiles, entries: &[Entry], notes: &mut Notes) -> Vec<Option<PathBuf>> {
    let num_kinds = entries.iter().map(|entry| entry.keys.len()).min().unwrap_or(0);
    let mut best = vec![None; entries.len()];
    let mut most = 0;
    for kind in 0..num_kinds {
        let keys: Vec<&ImageKey> = entries.iter().map(|entry| &entry.keys[kind]).collect();
        let found = files.find_all(&keys);
        let count = found.iter().flatten().count();
        if count > most {
            (best, most) = (found, count);
        }
    }
    let mut seen: BTreeMap<&PathBuf, usize> = BTreeMap::new();
    best.iter().flatten().for_each(|path| *seen.entry(path).or_default() += 1);
    if let Some((path, count)) = seen.into_iter().find(|&(_, count)| count > 1) {
        notes.add(format!("{count} cameras share the photograph {}", path.display()));
    }
    best
}

fn frame(
    root: &Path,
    source: &Path,
    entry: Entry,
    path: &Path,
    header: photo::Header,
    files: &ImageFiles,
    notes: &mut Notes,
) -> Result<Frame, SceneError> {
    let Entry { name, calibration, lens, camera_from_world, near_far, mask, .. } = entry;
    let image_path = root.join(path);
    check_optics(source, &name, calibration, &lens)?;
    let sensible = near_far.filter(|&(near, far)| near > 0.0 && far > near && far.is_finite());
    if sensible != near_far {
        notes.add_for_frame("the stated depth range is empty or not in front of the camera; ignored".to_owned());
    }
    let resolved = calibration::resolve(calibration, (header.width, header.height), header.orientation);
    let Resolved { intrinsics, width, height, orientation, notes: new } = resolved.map_err(|Unexplained(stated)| {
        let actual = (header.width, header.height);
        let (cameras, frame, image) = (source.to_owned(), name.clone(), image_path.clone());
        SceneError::SizeMismatch { cameras, frame, image, stated, actual }
    })?;
    new.into_iter().for_each(|note| notes.add_for_frame(note));
    let mask_path = match mask {
        None => files.mask_of(path).map(|mask| root.join(mask)),
        Some(mask) => {
            let found = files.existing(&mask);
            if found.is_none() {
                notes.add(format!("the mask {mask} of {name} does not exist; the whole photograph is used"));
            }
            found
        }
    };
    Ok(Frame {
        name,
        image_path,
        mask_path,
        width,
        height,
        intrinsics,
        lens,
        camera_from_world,
        near_far: sensible,
        orientation,
    })
}

fn check_optics(source: &Path, frame: &str, calibration: Calibration, lens: &Lens) -> Result<(), SceneError> {
    let sane = match calibration {
        Calibration::Sized(k, _) | Calibration::Unsized(k) | Calibration::Normalised(k) => {
            [k.fx, k.fy].iter().all(|f| f.is_finite() && *f > 0.0) && k.cx.is_finite() && k.cy.is_finite()
        }
        Calibration::FieldOfView(angle) => angle > 0.0 && angle < std::f64::consts::PI,
    };
    let reason = match (sane, lens.distort(DVec2::splat(0.1)).is_finite()) {
        (true, true) => return Ok(()),
        (false, _) => {
            format!("frame {frame}: the focal length or principal point is not a sensible number ({calibration:?})")
        }
        (true, false) => format!("frame {frame}: a distortion coefficient is not a finite number"),
    };
    Err(SceneError::Malformed { path: source.to_owned(), reason })
}

fn too_few(
    root: &Path,
    source: &Path,
    found: usize,
    stated: usize,
    missing: &[String],
    files: &ImageFiles,
) -> SceneError {
    let missing = match missing {
        [] => "add more photographs with poses".to_owned(),
        missing if files.is_empty() => format!("missing are {}, {}", abbreviated(missing), files.sample()),
        missing => format!("missing are {}; {}", abbreviated(missing), files.sample()),
    };
    let (cameras, root) = (source.to_owned(), root.to_owned());
    SceneError::TooFewImages { cameras, root, found, stated, missing }
}

/// The first few of a list of names.
pub(super) fn abbreviated(names: &[String]) -> String {
    let shown = names.iter().take(4).map(String::as_str).collect::<Vec<_>>().join(", ");
    if names.len() > 4 { format!("{shown}, ... ({} in all)", names.len()) } else { shown }
}

/// Warnings, those about single frames said once with their number.
#[derive(Default)]
struct Notes {
    once: Vec<String>,
    per_frame: BTreeMap<String, usize>,
}

impl Notes {
    fn add(&mut self, note: String) {
        self.once.push(note);
    }

    fn add_for_frame(&mut self, note: String) {
        *self.per_frame.entry(note).or_default() += 1;
    }

    fn into_warnings(self, num_frames: usize) -> Vec<String> {
        let counted = self.per_frame.into_iter().map(|(note, count)| {
            if count == num_frames { note } else { format!("{note} ({count} of {num_frames} photographs)") }
        });
        self.once.into_iter().chain(counted).collect()
    }
}
