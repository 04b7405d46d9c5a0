//! Open3D / Redwood `trajectory.log`: per frame a line of three integers and a 4x4 `world_from_camera`.
//!
//! OpenCV axes. The intrinsics are in a JSON file beside it (Open3D's `PinholeCameraIntrinsic`, pixel
//! centres at integers); without one, those of the PrimeSense sensor are taken, and said aloud.

use crate::scene::entry::{Calibration, CameraFile, Entry, ImageKey, index_intrinsics, pose_from_rows};
use crate::scene::error::{Fault, SceneError, read_bytes};
use crate::scene::tokens::{at_line, content_lines, integer, numbers, utf8};
use serde::Deserialize;
use std::path::Path;

/// K and size of the PrimeSense default of Open3D and the Redwood sets.
const PRIMESENSE: ([f64; 9], (usize, usize)) = ([525.0, 0.0, 319.5, 0.0, 525.0, 239.5, 0.0, 0.0, 1.0], (640, 480));

pub(in crate::scene) fn read(path: &Path) -> Result<CameraFile, SceneError> {
    let beside = ["camera_intrinsic.json", "intrinsic.json", "intrinsics.json"].map(|name| path.with_file_name(name));
    let found = beside.iter().find(|candidate| candidate.is_file());
    let calibration = match found {
        Some(file) => Some(parse_intrinsic(&read_bytes(file)?).map_err(|fault| fault.in_file(file))?),
        None => None,
    };
    parse(&read_bytes(path)?, calibration).map_err(|fault| fault.in_file(path))
}

#[derive(Deserialize)]
struct PinholeCameraIntrinsic {
    width: usize,
    height: usize,
    /// Column-major.
    intrinsic_matrix: [f64; 9],
}

pub(super) fn parse_intrinsic(bytes: &[u8]) -> Result<Calibration, Fault> {
    let json: PinholeCameraIntrinsic = serde_json::from_slice(bytes)
        .map_err(|error| Fault::text(format!("is not an Open3D PinholeCameraIntrinsic ({error})")))?;
    let m = json.intrinsic_matrix;
    let k = [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]];
    Ok(Calibration::Sized(index_intrinsics(&k), (json.width, json.height)))
}

pub(super) fn parse(bytes: &[u8], calibration: Option<Calibration>) -> Result<CameraFile, Fault> {
    let lines: Vec<(usize, &str)> = content_lines(utf8(bytes)?).collect();
    let mut warnings = Vec::new();
    let calibration = calibration.unwrap_or_else(|| {
        warnings.push(
            "NO INTRINSICS: trajectory.log has no intrinsic.json beside it, so the PrimeSense default is assumed \
             (f = 525, c = 319.5, 239.5 for 640x480); if the camera was another one, every depth will be wrong"
                .to_owned(),
        );
        Calibration::Sized(index_intrinsics(&PRIMESENSE.0), PRIMESENSE.1)
    });
    let mut entries = Vec::with_capacity(lines.len() / 5);
    for (rank, block) in lines.chunks(5).enumerate() {
        let (line, header) = block[0];
        let id: u64 = integer(header.split_whitespace().next().unwrap_or_default()).map_err(at_line(line))?;
        let mut rows = Vec::with_capacity(16);
        for &(line, row) in &block[1..] {
            rows.extend(numbers(row).map_err(at_line(line))?);
        }
        let name = id.to_string();
        let pose = pose_from_rows(&name, &rows).map_err(at_line(line))?.inverse();
        let keys = [ImageKey::Number(id), ImageKey::Rank(rank)];
        entries.push(Entry::new(name, calibration, pose).keys(keys));
    }
    Ok(CameraFile { warnings, ..CameraFile::new("Open3D trajectory.log", entries) })
}
