//! Rectified pairs with `calib.txt` beside them: Middlebury stereo (2014, 2021) and ETH3D two-view.
//!
//! Lines `key=value`: `cam0` and `cam1` are K, rows ended by `;`, pixel centres at integers; `baseline` is how far the
//! right camera stands along the left one's X axis. The world is the left camera. What bounds the disparity there follows
//! from the truth of those sets (`vmin`, `vmax`, `ndisp`) and is not read.

use crate::scene::entry::{Calibration, CameraFile, Entry, ImageKey, index_intrinsics};
use crate::scene::error::{Fault, SceneError, read_bytes};
use crate::scene::tokens::{at_line, content_lines, exactly, integer, number, numbers, utf8};
use glam::{DMat3, DVec3};
use std::path::Path;
use surfel_core::Rigid;

/// Photographs of the left and the right camera.
const NAMES: [&str; 2] = ["im0", "im1"];

pub(in crate::scene) fn read(path: &Path) -> Result<CameraFile, SceneError> {
    parse(&read_bytes(path)?).map_err(|fault| fault.in_file(path))
}

/// Whether the beginning of a `calib.txt` is of this kind; those of KITTI and others share the name.
pub(in crate::scene) fn looks_like(beginning: &[u8]) -> bool {
    utf8(beginning)
        .is_ok_and(|text| content_lines(text).any(|(_, line)| keyed(line).is_some_and(|(key, _)| key == "cam0")))
}

pub(super) fn parse(bytes: &[u8]) -> Result<CameraFile, Fault> {
    let text = utf8(bytes)?;
    let stated = |wanted: &str| {
        let mut lines = content_lines(text).filter_map(|(number, line)| Some((number, keyed(line)?)));
        lines.find_map(|(number, (key, value))| (key == wanted).then_some((number, value)))
    };
    let required = |key: &str| stated(key).ok_or_else(|| Fault::text(format!("does not state {key:?}")));
    let size = match (stated("width"), stated("height")) {
        (Some((line, width)), Some((next, height))) => {
            Some((integer(width).map_err(at_line(line))?, integer(height).map_err(at_line(next))?))
        }
        _ => None,
    };
    let (line, baseline) = required("baseline")?;
    let baseline = number(baseline).map_err(at_line(line))?;
    if !(baseline.is_finite() && baseline > 0.0) {
        return Err(at_line(line)(Fault::text(format!("the baseline is {baseline}, not a length"))));
    }
    let entry = |rank: usize, key: &str| {
        let (line, k) = required(key)?;
        let intrinsics = index_intrinsics(&matrix(k).map_err(at_line(line))?);
        let calibration = size.map_or(Calibration::Unsized(intrinsics), |size| Calibration::Sized(intrinsics, size));
        let translation = DVec3::new(-baseline * rank as f64, 0.0, 0.0);
        let pose = Rigid { rotation: DMat3::IDENTITY, translation };
        let keys = [ImageKey::Name(NAMES[rank].to_owned()), ImageKey::Rank(rank)];
        Ok(Entry::new(NAMES[rank], calibration, pose).keys(keys))
    };
    Ok(CameraFile::new("stereo calib.txt", vec![entry(0, "cam0")?, entry(1, "cam1")?]))
}

fn keyed(line: &str) -> Option<(&str, &str)> {
    line.split_once('=').map(|(key, value)| (key.trim(), value.trim()))
}

/// `[a b c; d e f; g h i]`.
fn matrix(text: &str) -> Result<[f64; 9], Fault> {
    exactly(&numbers(&text.replace(['[', ']', ';', ','], " "))?, "K")
}
