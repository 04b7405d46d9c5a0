//! The maps of one view from files of their own.
//!
//! Invariant: what is returned has the size of the photograph.

use crate::DataError;
use std::path::{Path, PathBuf};
use surfel_core::Grid;
use surfel_io::depth::read_pfm;
use surfel_io::photo::read_picture;

/// A mask pixel above this brightness is inside; JPEG-like noise in the black of a mask stays out.
const INSIDE: f32 = 10.0 / 255.0;

/// Sub-folders whose name `pick` accepts, sorted by name.
pub(crate) fn folders<T>(path: &Path, pick: impl Fn(&str) -> Option<T>) -> Result<Vec<(T, PathBuf)>, DataError> {
    let fault = |source| DataError::Read { path: path.to_owned(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(path).map_err(fault)? {
        let entry = entry.map_err(fault)?.path();
        let name = entry.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        if entry.is_dir()
            && let Some(item) = pick(&name)
        {
            found.push((name, item, entry));
        }
    }
    found.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(found.into_iter().map(|(_, item, path)| (item, path)).collect())
}

/// A PFM depth map in the unit of the file, if the file is there.
pub(crate) fn depth_if_any(path: &Path) -> Result<Option<Grid<f32>>, DataError> {
    if !path.exists() {
        return Ok(None);
    }
    Ok(Some(read_pfm(path)?))
}

/// A mask, if the file is there.
pub(crate) fn mask_if_any(path: &Path) -> Result<Option<Grid<bool>>, DataError> {
    if !path.exists() {
        return Ok(None);
    }
    Ok(Some(read_picture(path)?.map(|rgb| rgb.iter().any(|value| *value > INSIDE))))
}
