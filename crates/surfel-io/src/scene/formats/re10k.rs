//! RealEstate10K: a URL, then per frame `timestamp fx fy cx cy 0 0 [R | t]` with a 3x4 `camera_from_world`.
//!
//! Intrinsics are normalised by width and height (so continuous already), OpenCV axes. Frames are
//! named by timestamp or by running number in a folder beside the file.

use crate::scene::entry::{Calibration, CameraFile, Entry, ImageKey, pose_from_rows};
use crate::scene::error::{Fault, SceneError, read_bytes};
use crate::scene::tokens::{at_line, content_lines, exactly, numbers, utf8};
use std::path::Path;
use surfel_core::Intrinsics;

pub(in crate::scene) fn read(path: &Path) -> Result<CameraFile, SceneError> {
    parse(&read_bytes(path)?).map_err(|fault| fault.in_file(path))
}

/// True when the beginning of a text file looks like this format.
pub(in crate::scene) fn looks_like(bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = content_lines(&text).map(|(_, line)| line);
    let is_frame = |line: &str| numbers(line).is_ok_and(|values| values.len() == 19);
    lines.next().is_some_and(|first| is_frame(first) || first.contains("://") && lines.next().is_some_and(is_frame))
}

pub(super) fn parse(bytes: &[u8]) -> Result<CameraFile, Fault> {
    let frames = content_lines(utf8(bytes)?).filter(|(_, line)| !line.contains("://"));
    let entries = frames
        .enumerate()
        .map(|(rank, (number, line))| entry(rank, line).map_err(at_line(number)))
        .collect::<Result<_, _>>()?;
    Ok(CameraFile::new("RealEstate10K text", entries))
}

fn entry(rank: usize, line: &str) -> Result<Entry, Fault> {
    let timestamp = line.split_whitespace().next().unwrap_or_default();
    let values: [f64; 19] = exactly(&numbers(line)?, "a frame")?;
    let pose = pose_from_rows(timestamp, &values[7..])?;
    let intrinsics = Intrinsics { fx: values[1], fy: values[2], cx: values[3], cy: values[4] };
    let mut keys = vec![ImageKey::Name(timestamp.to_owned())];
    keys.extend(timestamp.parse().map(ImageKey::Number).ok().or(Some(ImageKey::Number(u64::MAX))));
    keys.extend([ImageKey::Number(rank as u64), ImageKey::Rank(rank)]);
    Ok(Entry::new(timestamp, Calibration::Normalised(intrinsics), pose).keys(keys))
}
