//! MVSNet, BlendedMVS and DTU `%08d_cam.txt`: extrinsic 4x4, intrinsic 3x3, depth range.
//!
//! OpenCV axes, pixel centres at integers. The intrinsics may be for another resolution than the
//! images (DTU's training cameras are for a quarter); the size is not stated, so `matching` infers it.

use super::{file_name, files_ending_with};
use crate::scene::entry::{Calibration, CameraFile, Entry, ImageKey, index_intrinsics, pose_from_rows};
use crate::scene::error::{Fault, SceneError, read_bytes};
use crate::scene::tokens::{exactly, numbers, utf8};
use std::path::Path;

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

pub(super) fn parse(name: &str, rank: usize, bytes: &[u8]) -> Result<Entry, Fault> {
    let text = utf8(bytes)?;
    let (extrinsic, rest) = text
        .split_once("extrinsic")
        .and_then(|(_, rest)| rest.split_once("intrinsic"))
        .ok_or_else(|| Fault::text("must hold the words extrinsic and intrinsic"))?;
    let rest = numbers(rest)?;
    if rest.len() < 9 {
        return Err(Fault::text(format!("intrinsic needs 9 numbers, not {}", rest.len())));
    }
    let pose = pose_from_rows(name, &exactly::<16>(&numbers(extrinsic)?, "extrinsic")?)?;
    let intrinsics = index_intrinsics(&exactly::<9>(&rest[..9], "intrinsic")?);
    let number = name.parse().unwrap_or(rank as u64);
    let mut keys = vec![ImageKey::Number(number), ImageKey::Rect(number.saturating_add(1))];
    keys.push(ImageKey::Rank(rank));
    let entry = Entry::new(name, Calibration::Unsized(intrinsics), pose).keys(keys);
    Ok(Entry { near_far: depth_range(&rest[9..]), ..entry })
}

/// `min interval [num [max]]`; BlendedMVS has ranges that are empty or negative, which say nothing.
fn depth_range(line: &[f64]) -> Option<(f64, f64)> {
    let (near, interval) = (*line.first()?, *line.get(1)?);
    let planes = line.get(2).copied().unwrap_or(DEFAULT_NUM_DEPTHS);
    let far = line.get(3).copied().unwrap_or(near + interval * (planes - 1.0));
    (near > 0.0 && far > near && far.is_finite()).then_some((near, far))
}
