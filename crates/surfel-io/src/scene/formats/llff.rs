//! LLFF `poses_bounds.npy`: N rows of a 3x5 matrix (`world_from_camera` 3x4, then H, W, f) and near, far.
//!
//! The camera axes are **down, right, back**. One focal length, principal point in the middle. Rows
//! belong to the sorted images.

use crate::npy::Array;
use crate::scene::entry::{Calibration, CameraFile, Entry, ImageKey, rigid};
use crate::scene::error::{Fault, SceneError, read_bytes};
use glam::{DMat3, DVec3};
use std::path::Path;
use surfel_core::Intrinsics;

pub(in crate::scene) fn read(path: &Path) -> Result<CameraFile, SceneError> {
    parse(&read_bytes(path)?).map_err(|fault| fault.in_file(path))
}

pub(super) fn parse(bytes: &[u8]) -> Result<CameraFile, Fault> {
    let array = Array::parse(bytes).map_err(Fault::Text)?;
    let [rows, 15 | 17] = array.shape[..] else {
        return Err(Fault::text(format!("has shape {:?}, not (N, 17)", array.shape)));
    };
    let entries = (0..rows).map(|index| entry(index, array.row(index))).collect::<Result<_, _>>()?;
    Ok(CameraFile::new("LLFF poses_bounds", entries))
}

fn entry(index: usize, row: &[f64]) -> Result<Entry, Fault> {
    let frame = index.to_string();
    let column = |c: usize| DVec3::new(row[c], row[5 + c], row[10 + c]);
    let (down, right, back) = (column(0), column(1), column(2));
    let world_from_camera = rigid(&frame, DMat3::from_cols(right, down, -back), column(3))?;
    let DVec3 { x: height, y: width, z: focal } = column(4);
    if !(height >= 1.0 && width >= 1.0 && height < 1e6 && width < 1e6) {
        return Err(Fault::text(format!("row {index}: states an image of {width} x {height} pixels")));
    }
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: 0.5 * width, cy: 0.5 * height };
    let size = (width.round() as usize, height.round() as usize);
    let near_far = row.get(15).zip(row.get(16)).map(|(&near, &far)| (near, far));
    let entry = Entry::new(frame, Calibration::Sized(intrinsics, size), world_from_camera.inverse());
    let near_far = near_far.filter(|&(near, far)| near > 0.0 && far > near && far.is_finite());
    Ok(Entry { near_far, ..entry }.keys([ImageKey::Rank(index)]))
}
