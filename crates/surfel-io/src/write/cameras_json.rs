//! `cameras.json`: the working cameras in our own minimal format, so that the output can be read back.
//!
//! Invariant: numbers round-trip exactly (shortest decimal of each f64).

use serde::Serialize;
use std::io::{self, Write};
use surfel_core::Camera;

/// A camera of the output and the picture it belongs to.
#[derive(Clone, Copy, Debug)]
pub struct CameraRecord<'a> {
    /// Path of the picture relative to the JSON file.
    pub image: &'a str,
    /// Camera in the scene frame, at the size of `image`.
    pub camera: &'a Camera,
    /// Nearest and farthest z-depth of interest, scene units.
    pub near_far: Option<(f64, f64)>,
}

#[derive(Serialize)]
struct Entry<'a> {
    image: &'a str,
    width: usize,
    height: usize,
    /// Row-major; principal point in continuous pixels (first pixel centre at 0.5).
    #[serde(rename = "K")]
    k: [f64; 9],
    /// Row-major 4x4.
    camera_from_world: [f64; 16],
    #[serde(skip_serializing_if = "Option::is_none")]
    near: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    far: Option<f64>,
}

/// Writes `[{image, width, height, K, camera_from_world, near?, far?}]`.
///
/// # Errors
/// When `out` refuses.
pub fn write_cameras_json(out: &mut impl Write, cameras: &[CameraRecord]) -> io::Result<()> {
    let entries: Vec<Entry> = cameras.iter().map(entry).collect();
    serde_json::to_writer_pretty(&mut *out, &entries)?;
    out.write_all(b"\n")
}

fn entry<'a>(record: &CameraRecord<'a>) -> Entry<'a> {
    let k = &record.camera.intrinsics;
    Entry {
        image: record.image,
        width: record.camera.width,
        height: record.camera.height,
        k: [k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0],
        camera_from_world: record.camera.camera_from_world.to_mat4().transpose().to_cols_array(),
        near: record.near_far.map(|(near, _)| near),
        far: record.near_far.map(|(_, far)| far),
    }
}
