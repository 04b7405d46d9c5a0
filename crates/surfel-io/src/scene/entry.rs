//! What a camera file says about each photograph, before any photograph was looked at.
//!
//! Every format reader produces a [`CameraFile`]; `matching` joins it with the files on disk. Poses are
//! already `camera_from_world` in OpenCV axes and have passed the gate of [`Rigid::from_matrix`].

use super::error::Fault;
use glam::{DMat3, DVec3};
use surfel_core::{Intrinsics, Lens, Rigid};

/// The content of one camera file (or folder of camera files).
#[derive(Debug, Default)]
pub(crate) struct CameraFile {
    pub dialect: &'static str,
    pub entries: Vec<Entry>,
    /// Sparse points and the entries that see each.
    pub points: Vec<(DVec3, Vec<u32>)>,
    pub warnings: Vec<String>,
}

impl CameraFile {
    pub fn new(dialect: &'static str, entries: Vec<Entry>) -> Self {
        Self { dialect, entries, ..Self::default() }
    }
}

/// One photograph as the camera file knows it.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub name: String,
    /// Ways to find the image, best first; all entries of a file list the same kinds in the same order.
    pub keys: Vec<ImageKey>,
    pub calibration: Calibration,
    pub lens: Lens,
    pub camera_from_world: Rigid,
    pub near_far: Option<(f64, f64)>,
    pub mask: Option<String>,
}

impl Entry {
    pub fn new(name: impl Into<String>, calibration: Calibration, camera_from_world: Rigid) -> Self {
        let name = name.into();
        let keys = vec![ImageKey::Name(name.clone())];
        Self { name, keys, calibration, lens: Lens::None, camera_from_world, near_far: None, mask: None }
    }

    pub fn keys(self, keys: impl Into<Vec<ImageKey>>) -> Self {
        Self { keys: keys.into(), ..self }
    }
}

/// How an image file is found.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum ImageKey {
    /// By path or name, with or without folder and extension.
    Name(String),
    /// By the number its name consists of or ends with.
    Number(u64),
    /// DTU's `rect_NNN_L_...`, by its 1-based number.
    Rect(u64),
    /// By its place in the sorted image folder; only if that holds exactly as many images as entries.
    Rank(usize),
}

/// Intrinsics and what they are relative to; always continuous pixel coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Calibration {
    /// Pixels of an image of this width and height.
    Sized(Intrinsics, (usize, usize)),
    /// Pixels of an image whose size is not stated.
    Unsized(Intrinsics),
    /// `fx`, `cx` in image widths, `fy`, `cy` in image heights.
    Normalised(Intrinsics),
    /// Horizontal field of view in radians; square pixels, principal point in the middle.
    FieldOfView(f64),
}

/// A pose from the 12 or 16 numbers of a row-major `[R | t]`; `frame` is for the message.
pub(crate) fn pose_from_rows(frame: &str, rows: &[f64]) -> Result<Rigid, Fault> {
    let m = |row: usize, column: usize| rows[4 * row + column];
    if rows.len() != 12 && rows.len() != 16 {
        return Err(Fault::text(format!("frame {frame}: the pose has {} numbers, not 12 or 16", rows.len())));
    }
    if rows.len() == 16 && !is_affine_row(&rows[12..]) {
        return Err(Fault::text(format!(
            "frame {frame}: the last row of the pose is {:?}, not 0 0 0 1 (is the matrix transposed?)",
            &rows[12..]
        )));
    }
    let rotation =
        rotation_from_rows(&[m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2)]);
    rigid(frame, rotation, DVec3::new(m(0, 3), m(1, 3), m(2, 3)))
}

fn is_affine_row(row: &[f64]) -> bool {
    // NaN passes on to the pose check, whose message is the better one.
    row.iter().zip([0.0, 0.0, 0.0, 1.0]).all(|(a, b)| a.is_nan() || (a - b).abs() <= 1e-3)
}

/// Row-major 3x3.
pub(crate) fn rotation_from_rows(rows: &[f64; 9]) -> DMat3 {
    DMat3::from_cols_array(rows).transpose()
}

/// A checked pose; `frame` is for the message.
pub(crate) fn rigid(frame: &str, rotation: DMat3, translation: DVec3) -> Result<Rigid, Fault> {
    Rigid::from_matrix(rotation, translation).map_err(|source| Fault::Pose { frame: frame.to_owned(), source })
}

/// `camera_from_world` (OpenCV) of a `world_from_camera` whose camera looks along -Z with Y up (OpenGL).
pub(crate) fn from_opengl(world_from_camera: &Rigid) -> Rigid {
    let flip = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    Rigid { rotation: world_from_camera.rotation * flip, ..*world_from_camera }.inverse()
}

/// fx, fy, cx, cy of a row-major K in index coordinates (first pixel centre at 0) as continuous intrinsics.
pub(crate) fn index_intrinsics(k: &[f64; 9]) -> Intrinsics {
    Intrinsics::from_index_coordinates(k[0] / k[8], k[4] / k[8], k[2] / k[8], k[5] / k[8])
}
