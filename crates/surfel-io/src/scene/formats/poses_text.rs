//! `poses.txt` (one `world_from_camera` per line), `K.txt` (3x3) and, if there, `frames.txt` (image names).
//!
//! The layout of DeepVideoMVS and many small RGB-D sets. OpenCV axes, pixel centres at integers.

use crate::scene::entry::{Calibration, CameraFile, Entry, ImageKey, index_intrinsics, pose_from_rows};
use crate::scene::error::{Fault, SceneError, read_bytes};
use crate::scene::tokens::{at_line, content_lines, exactly, numbers, utf8};
use std::path::Path;

pub(in crate::scene) fn read(path: &Path) -> Result<CameraFile, SceneError> {
    let beside = |name: &str| path.with_file_name(name);
    let k_path = beside("K.txt");
    let k = parse_k(&read_bytes(&k_path)?).map_err(|fault| fault.in_file(&k_path))?;
    let frames_path = beside("frames.txt");
    let frames = if frames_path.is_file() { Some(read_bytes(&frames_path)?) } else { None };
    parse(&read_bytes(path)?, &k, frames.as_deref()).map_err(|fault| fault.in_file(path))
}

pub(super) fn parse_k(bytes: &[u8]) -> Result<[f64; 9], Fault> {
    exactly(&numbers(utf8(bytes)?)?, "K")
}

pub(super) fn parse(poses: &[u8], k: &[f64; 9], frames: Option<&[u8]>) -> Result<CameraFile, Fault> {
    let poses: Vec<(usize, &str)> = content_lines(utf8(poses)?).collect();
    let names = match frames {
        Some(frames) => content_lines(utf8(frames)?).map(|(_, name)| name.to_owned()).collect(),
        None => (0..poses.len()).map(|index| index.to_string()).collect::<Vec<_>>(),
    };
    if names.len() != poses.len() {
        return Err(Fault::text(format!(
            "has {} poses, but frames.txt beside it names {} frames",
            poses.len(),
            names.len()
        )));
    }
    let calibration = Calibration::Unsized(index_intrinsics(k));
    let entry = |(rank, (line, name)): (usize, (&(usize, &str), String))| {
        let rows = numbers(line.1).map_err(at_line(line.0))?;
        let pose = pose_from_rows(&name, &rows).map_err(at_line(line.0))?.inverse();
        let keys = match frames {
            Some(_) => vec![ImageKey::Name(name.clone()), ImageKey::Rank(rank)],
            None => vec![ImageKey::Rank(rank), ImageKey::Number(rank as u64)],
        };
        Ok(Entry::new(name, calibration, pose).keys(keys))
    };
    let entries = poses.iter().zip(names).enumerate().map(entry).collect::<Result<_, Fault>>()?;
    Ok(CameraFile::new("poses.txt and K.txt", entries))
}
