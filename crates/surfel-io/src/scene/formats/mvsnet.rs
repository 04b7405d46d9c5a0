//! MVSNet, BlendedMVS and DTU `%08d_cam.txt`: extrinsic 4x4, intrinsic 3x3, depth range.
//!
//! OpenCV axes, pixel centres at integers. The intrinsics may be for another resolution than the
//! images (DTU's training cameras are for a quarter); the size is not stated, so `matching` infers it.

use super::{file_name, files_ending_with};
use crate::scene::entry::{Calibration, CameraFile, Entry, ImageKey, pose_from_rows};
use crate::scene::error::{Fault, SceneError, read_bytes};
use crate::scene::tokens::{exactly, numbers, utf8};
use std::path::Path;
use surfel_core::{Intrinsics, Rigid};

/// Planes of a plane sweep when the file states none.
const DEFAULT_NUM_DEPTHS: f64 = 192.0;

pub(in crate::scene) fn read(folder: &Path) -> Result<CameraFile, SceneError> {
    let files = files_ending_with(folder, "_cam.txt")?;
    let entry = |(rank, path): (usize, &std::path::PathBuf)| {
        let name = file_name(path).trim_end_matches("_cam.txt").to_owned();
        parse(&name, rank, &read_bytes(path)?).map_err(|fault| fault.in_file(path))
    };
    let entries = files.iter().enumerate().map(entry).collect::<Result<_, _>>()?;
    Ok(CameraFile::new("MVSNet cam.txt", entries))
}

/// What one camera file says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CamText {
    /// World to camera, OpenCV axes, unit of the file.
    pub camera_from_world: Rigid,
    /// fx, fy, cx, cy as written: first pixel centre at 0, for a resolution that the file does not state.
    pub intrinsics: [f64; 4],
    /// Nearest and farthest depth, unit of the file.
    pub depth_range: Option<(f64, f64)>,
}

/// Reads one camera file, for data sets that know which resolution it is for.
///
/// # Errors
/// [`SceneError`], naming the file.
pub fn read_cam_text(path: &Path) -> Result<CamText, SceneError> {
    let name = file_name(path);
    parse_text(name.trim_end_matches("_cam.txt"), &read_bytes(path)?).map_err(|fault| fault.in_file(path))
}

fn parse_text(name: &str, bytes: &[u8]) -> Result<CamText, Fault> {
    let text = utf8(bytes)?;
    let (extrinsic, rest) = text
        .split_once("extrinsic")
        .and_then(|(_, rest)| rest.split_once("intrinsic"))
        .ok_or_else(|| Fault::text("must hold the words extrinsic and intrinsic"))?;
    let rest = numbers(rest)?;
    if rest.len() < 9 {
        return Err(Fault::text(format!("intrinsic needs 9 numbers, not {}", rest.len())));
    }
    let camera_from_world = pose_from_rows(name, &exactly::<16>(&numbers(extrinsic)?, "extrinsic")?)?;
    let k = &rest[..9];
    let intrinsics = [k[0] / k[8], k[4] / k[8], k[2] / k[8], k[5] / k[8]];
    Ok(CamText { camera_from_world, intrinsics, depth_range: depth_range(&rest[9..]) })
}

pub(super) fn parse(name: &str, rank: usize, bytes: &[u8]) -> Result<Entry, Fault> {
    let CamText { camera_from_world, intrinsics: [fx, fy, cx, cy], depth_range } = parse_text(name, bytes)?;
    let intrinsics = Intrinsics::from_index_coordinates(fx, fy, cx, cy);
    let number = name.parse().unwrap_or(rank as u64);
    let mut keys = vec![ImageKey::Number(number), ImageKey::Rect(number.saturating_add(1))];
    keys.push(ImageKey::Rank(rank));
    let entry = Entry::new(name, Calibration::Unsized(intrinsics), camera_from_world).keys(keys);
    Ok(Entry { near_far: depth_range, ..entry })
}

/// `min interval [num [max]]`; BlendedMVS has ranges that are empty or negative, which say nothing.
fn depth_range(line: &[f64]) -> Option<(f64, f64)> {
    let (near, interval) = (*line.first()?, *line.get(1)?);
    let planes = line.get(2).copied().unwrap_or(DEFAULT_NUM_DEPTHS);
    let far = line.get(3).copied().unwrap_or(near + interval * (planes - 1.0));
    (near > 0.0 && far > near && far.is_finite()).then_some((near, far))
}
