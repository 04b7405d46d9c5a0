//! Strecha et al.'s `<image>.camera`: K, a line of zeros, `world_from_camera` rotation, centre, image size.
//!
//! `x_camera = Rᵀ (X - C)`, OpenCV axes. K is for the stated size, which is often not the size of the
//! images at hand.

use super::{file_name, files_ending_with};
use crate::scene::entry::{Calibration, CameraFile, Entry, index_intrinsics, rigid, rotation_from_rows};
use crate::scene::error::{Fault, SceneError, read_bytes};
use crate::scene::tokens::{exactly, numbers, utf8};
use glam::DVec3;
use std::path::Path;

pub(in crate::scene) fn read(folder: &Path) -> Result<CameraFile, SceneError> {
    let files = files_ending_with(folder, ".camera")?;
    let entry = |path: &std::path::PathBuf| {
        let name = file_name(path).trim_end_matches(".camera").to_owned();
        parse(&name, &read_bytes(path)?).map_err(|fault| fault.in_file(path))
    };
    Ok(CameraFile::new("Strecha .camera", files.iter().map(entry).collect::<Result<_, _>>()?))
}

pub(super) fn parse(name: &str, bytes: &[u8]) -> Result<Entry, Fault> {
    let values: [f64; 26] = exactly(&numbers(utf8(bytes)?)?, "a .camera file (K, 0 0 0, R, C, size)")?;
    let k: [f64; 9] = exactly(&values[..9], "K")?;
    let world_from_camera =
        rigid(name, rotation_from_rows(&exactly(&values[12..21], "R")?), DVec3::from_slice(&values[21..24]))?;
    let (width, height) = (values[24], values[25]);
    if !(width >= 1.0 && height >= 1.0 && width < 1e6 && height < 1e6) {
        return Err(Fault::text(format!("states an image of {width} x {height} pixels")));
    }
    let size = (width as usize, height as usize);
    Ok(Entry::new(name, Calibration::Sized(index_intrinsics(&k), size), world_from_camera.inverse()))
}
