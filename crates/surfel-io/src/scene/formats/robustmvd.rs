//! The robustmvd sample layout: `cameras.npz` with `K` (N,3,3) and `to_ref_transform` (N,4,4).
//!
//! The world is the key view's camera: `to_ref_transform[i]` maps its coordinates to those of view `i`
//! (despite the name). Images are `key.*`, `source_0.*`, ..., or simply in sorted order.

use super::idr::fault;
use crate::npy::Npz;
use crate::scene::entry::{Calibration, CameraFile, Entry, ImageKey, index_intrinsics, pose_from_rows};
use crate::scene::error::{Fault, SceneError, read_bytes};
use crate::scene::tokens::exactly;
use std::path::Path;

pub(in crate::scene) fn read(path: &Path) -> Result<CameraFile, SceneError> {
    parse(&read_bytes(path)?).map_err(|fault| fault.in_file(path))
}

pub(super) fn parse(bytes: &[u8]) -> Result<CameraFile, Fault> {
    let mut npz = Npz::from_bytes(bytes, Path::new("")).map_err(fault)?;
    let k = npz.array("K").map_err(fault)?;
    let poses = npz.array("to_ref_transform").map_err(fault)?;
    let shapes_agree = matches!((&k.shape[..], &poses.shape[..]), ([n, 3, 3], [m, 4, 4]) if n == m);
    if !shapes_agree {
        return Err(Fault::text(format!(
            "K has shape {:?} and to_ref_transform {:?}; they must be (N, 3, 3) and (N, 4, 4)",
            k.shape, poses.shape
        )));
    }
    let entry = |index: usize| {
        let name = if index == 0 { "key".to_owned() } else { format!("source_{}", index - 1) };
        let pose = pose_from_rows(&name, poses.row(index))?;
        let intrinsics = index_intrinsics(&exactly::<9>(k.row(index), "K")?);
        let keys = [ImageKey::Name(name.clone()), ImageKey::Rank(index)];
        Ok(Entry::new(name, Calibration::Unsized(intrinsics), pose).keys(keys))
    };
    let entries = (0..k.shape[0]).map(entry).collect::<Result<_, Fault>>()?;
    Ok(CameraFile::new("robustmvd cameras", entries))
}
