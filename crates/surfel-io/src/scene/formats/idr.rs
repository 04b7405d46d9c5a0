//! IDR and NeuS `cameras.npz`: `world_mat_i = K [R | t]` and the unit sphere `scale_mat_i`.
//!
//! OpenCV axes, pixel centres at integers. Cameras stay in the world of `world_mat`; `scale_mat` gives
//! only the depth range. Images are matched by number, so a folder may hold a subset of the views.

use crate::npy::{Array, NpyError, Npz};
use crate::scene::entry::{Calibration, CameraFile, Entry, ImageKey, index_intrinsics, rigid};
use crate::scene::error::{Fault, SceneError, read_bytes};
use crate::scene::tokens::exactly;
use glam::{DMat3, DMat4, DVec3};
use std::path::Path;
use surfel_core::Rigid;

pub(in crate::scene) fn read(path: &Path) -> Result<CameraFile, SceneError> {
    parse(&read_bytes(path)?).map_err(|fault| fault.in_file(path))
}

pub(super) fn parse(bytes: &[u8]) -> Result<CameraFile, Fault> {
    let mut npz = Npz::from_bytes(bytes, Path::new("")).map_err(fault)?;
    let names = npz.names();
    let mut numbers: Vec<u64> = names.iter().filter_map(|name| name.strip_prefix("world_mat_")?.parse().ok()).collect();
    numbers.sort_unstable();
    if numbers.is_empty() {
        return Err(Fault::text("has no array world_mat_0"));
    }
    let mut entries = Vec::with_capacity(numbers.len());
    let mut largest_skew = 0.0f64;
    for (rank, &number) in numbers.iter().enumerate() {
        let frame = format!("world_mat_{number}");
        let mut projection = matrix4(&npz.array(&frame).map_err(fault)?, &frame)?;
        let camera_mat = format!("camera_mat_{number}");
        // Some packs put K into camera_mat and leave world_mat = [R | t].
        if is_rotation(DMat3::from_mat4(projection)) && names.contains(&camera_mat) {
            projection = matrix4(&npz.array(&camera_mat).map_err(fault)?, &camera_mat)? * projection;
        }
        let (k, pose) = decompose(&frame, projection)?;
        largest_skew = largest_skew.max((k[1] / k[0]).abs());
        let scale_mat = format!("scale_mat_{number}");
        let near_far = match names.contains(&scale_mat) {
            true => sphere_range(&pose, matrix4(&npz.array(&scale_mat).map_err(fault)?, &scale_mat)?),
            false => None,
        };
        let entry = Entry::new(number.to_string(), Calibration::Unsized(index_intrinsics(&k)), pose)
            .keys([ImageKey::Number(number), ImageKey::Rank(rank)]);
        entries.push(Entry { near_far, ..entry });
    }
    let mut file = CameraFile::new("IDR/NeuS world_mat", entries);
    if largest_skew > 1e-3 {
        file.warnings.push(format!(
            "the projection matrices have skew (up to {largest_skew:.4} of the focal length), which is left out"
        ));
    }
    Ok(file)
}

/// An [`NpyError`] about bytes whose path the caller will add.
pub(super) fn fault(error: NpyError) -> Fault {
    match error {
        NpyError::Malformed { reason, .. } => Fault::Text(reason),
        read => Fault::Text(read.to_string()),
    }
}

fn matrix4(array: &Array, name: &str) -> Result<DMat4, Fault> {
    if array.shape != [4, 4] {
        return Err(Fault::text(format!("array {name:?} has shape {:?}, not [4, 4]", array.shape)));
    }
    Ok(DMat4::from_cols_array(&exactly::<16>(&array.data, name)?).transpose())
}

fn is_rotation(m: DMat3) -> bool {
    (m * m.transpose() - DMat3::IDENTITY).to_cols_array().iter().all(|entry| entry.abs() < 1e-3)
}

/// RQ decomposition of a projection matrix: row-major K with K22 = 1 and a positive diagonal, and the pose.
///
/// A projection matrix is defined up to its sign, so it cannot show whether the world is mirrored.
fn decompose(frame: &str, projection: DMat4) -> Result<([f64; 9], Rigid), Fault> {
    let sign = if DMat3::from_mat4(projection).determinant() < 0.0 { -1.0 } else { 1.0 };
    let m = DMat3::from_mat4(projection) * sign;
    let offset = projection.w_axis.truncate() * sign;
    let [a, b, c] = [m.row(0), m.row(1), m.row(2)];
    let k22 = c.length();
    let r2 = c / k22;
    let k12 = b.dot(r2);
    let k11 = (b - r2 * k12).length();
    let r1 = (b - r2 * k12) / k11;
    let (k02, k01) = (a.dot(r2), a.dot(r1));
    let rest = a - r2 * k02 - r1 * k01;
    let k00 = rest.length();
    let rotation = DMat3::from_cols(rest / k00, r1, r2).transpose();
    let k = DMat3::from_cols_array(&[k00, k01, k02, 0.0, k11, k12, 0.0, 0.0, k22]).transpose();
    if !(k00 > 0.0 && k11 > 0.0 && k22 > 0.0 && k.is_finite() && offset.is_finite()) {
        return Err(Fault::text(format!("{frame} is not a projection matrix (its 3x3 part is singular)")));
    }
    let pose = rigid(frame, rotation, k.inverse() * offset)?;
    Ok(((k.transpose().to_cols_array()).map(|entry| entry / k22), pose))
}

/// Depth range of the unit sphere's image under `scale_mat`.
fn sphere_range(pose: &Rigid, scale_mat: DMat4) -> Option<(f64, f64)> {
    let radius = DMat3::from_mat4(scale_mat).determinant().abs().cbrt();
    let depth = pose.transform(scale_mat.transform_point3(DVec3::ZERO)).z;
    let (near, far) = (depth - radius, depth + radius);
    (near > 0.0 && far.is_finite() && radius > 0.0).then_some((near, far))
}
