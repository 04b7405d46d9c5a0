//! Middlebury multi-view stereo `*_par.txt`: one line per image, `name K(9) R(9) t(3)`, `P = K [R | t]`.
//!
//! OpenCV axes; the calibration toolbox behind it puts pixel centres at integers. The first line is the
//! number of images in the published files and may be missing.

use crate::scene::entry::{Calibration, CameraFile, Entry, index_intrinsics, rigid, rotation_from_rows};
use crate::scene::error::{Fault, SceneError, read_bytes};
use crate::scene::tokens::{at_line, content_lines, exactly, numbers, utf8};
use glam::DVec3;
use std::path::Path;

pub(in crate::scene) fn read(path: &Path) -> Result<CameraFile, SceneError> {
    parse(&read_bytes(path)?).map_err(|fault| fault.in_file(path))
}

pub(super) fn parse(bytes: &[u8]) -> Result<CameraFile, Fault> {
    let lines = content_lines(utf8(bytes)?).filter(|(_, line)| line.contains(char::is_whitespace));
    let entries = lines.map(|(number, line)| entry(line).map_err(at_line(number))).collect::<Result<_, _>>()?;
    Ok(CameraFile::new("Middlebury par.txt", entries))
}

fn entry(line: &str) -> Result<Entry, Fault> {
    let (name, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    let values: [f64; 21] = exactly(&numbers(rest)?, "an image's camera (K, R, t)")?;
    let k: [f64; 9] = exactly(&values[..9], "K")?;
    let rotation = rotation_from_rows(&exactly(&values[9..18], "R")?);
    let pose = rigid(name, rotation, DVec3::from_slice(&values[18..]))?;
    Ok(Entry::new(name, Calibration::Unsized(index_intrinsics(&k)), pose))
}
