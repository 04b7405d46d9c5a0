//! One file per camera format: bytes in, [`CameraFile`](super::entry::CameraFile) out.
//!
//! Each module has a `read` that knows files and a `parse` that knows only bytes (and is fed random ones
//! in `bad_bytes`). All conversions of axes, directions and pixel centres happen here and nowhere else.

pub(super) mod cameras_json;
pub(super) mod colmap;
pub(super) mod idr;
pub(super) mod llff;
pub(super) mod middlebury;
pub(super) mod mvsnet;
pub(super) mod poses_text;
pub(super) mod re10k;
pub(super) mod robustmvd;
pub(super) mod stereo_calib;
pub(super) mod strecha;
pub(super) mod trajectory_log;
pub(super) mod transforms;

#[cfg(test)]
mod bad_bytes;

use super::entry::CameraFile;
use super::error::SceneError;
use super::format::FormatKind;
use std::path::{Path, PathBuf};

/// Reads the cameras at `source` (a file, or a folder for formats of many files).
pub(super) fn read(kind: FormatKind, source: &Path) -> Result<CameraFile, SceneError> {
    match kind {
        FormatKind::Colmap => colmap::read(source),
        FormatKind::Transforms => transforms::read(source),
        FormatKind::Idr => idr::read(source),
        FormatKind::RobustMvd => robustmvd::read(source),
        FormatKind::MvsNet => mvsnet::read(source),
        FormatKind::Llff => llff::read(source),
        FormatKind::RealEstate10k => re10k::read(source),
        FormatKind::CamerasJson => cameras_json::read(source),
        FormatKind::Middlebury => middlebury::read(source),
        FormatKind::Strecha => strecha::read(source),
        FormatKind::StereoCalib => stereo_calib::read(source),
        FormatKind::PosesText => poses_text::read(source),
        FormatKind::TrajectoryLog => trajectory_log::read(source),
    }
}

/// Files of a folder whose name ends with `suffix`, sorted by name.
fn files_ending_with(folder: &Path, suffix: &str) -> Result<Vec<PathBuf>, SceneError> {
    let fault = |source| SceneError::Read { path: folder.to_owned(), source };
    let mut files = Vec::new();
    for item in std::fs::read_dir(folder).map_err(fault)? {
        let path = item.map_err(fault)?.path();
        if path.is_file() && file_name(&path).ends_with(suffix) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// The last component of a path as text.
fn file_name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}
