//! The project's own `cameras.json`, the one format meant to be written by hand.
//!
//! A list of `{image, width, height, K, camera_from_world, distortion?, mask?, near?, far?}`: K is 3x3
//! (9 numbers or 3 rows) in pixels with the first pixel centre at **0.5**, `camera_from_world` 4x4 in
//! OpenCV axes, `distortion` OpenCV's `k1 k2 p1 p2 [k3 [k4 k5 k6]]`. Also read: one object with shared
//! `width`, `height`, `K`, a `convention` sentence and `frames` of `{image, R, C}`, `x_camera = R (X - C)`.

use crate::scene::entry::{Calibration, CameraFile, Entry, pose_from_rows, rigid, rotation_from_rows};
use crate::scene::error::{Fault, SceneError, read_bytes};
use crate::scene::tokens::exactly;
use glam::DVec3;
use serde::Deserialize;
use std::path::Path;
use surfel_core::lens::Polynomial;
use surfel_core::{Intrinsics, Lens};

pub(in crate::scene) fn read(path: &Path) -> Result<CameraFile, SceneError> {
    parse(&read_bytes(path)?).map_err(|fault| fault.in_file(path))
}

/// A matrix as one list or as a list of rows.
#[derive(Deserialize, Clone)]
#[serde(untagged)]
enum Matrix {
    Flat(Vec<f64>),
    Rows(Vec<Vec<f64>>),
}

impl Matrix {
    fn flat(&self) -> Vec<f64> {
        match self {
            Self::Flat(numbers) => numbers.clone(),
            Self::Rows(rows) => rows.concat(),
        }
    }
}

#[derive(Deserialize)]
struct JsonFrame {
    image: String,
    width: Option<usize>,
    height: Option<usize>,
    #[serde(rename = "K")]
    k: Option<Matrix>,
    camera_from_world: Option<Matrix>,
    #[serde(rename = "R")]
    r: Option<Matrix>,
    #[serde(rename = "C")]
    c: Option<[f64; 3]>,
    distortion: Option<Vec<f64>>,
    mask: Option<String>,
    near: Option<f64>,
    far: Option<f64>,
}

#[derive(Deserialize)]
struct JsonScene {
    #[serde(default)]
    convention: String,
    width: Option<usize>,
    height: Option<usize>,
    #[serde(rename = "K")]
    k: Option<Matrix>,
    frames: Vec<JsonFrame>,
}

pub(super) fn parse(bytes: &[u8]) -> Result<CameraFile, Fault> {
    let fault = |error: serde_json::Error| {
        Fault::text(format!("is not a list of cameras with image, width, height, K and camera_from_world ({error})"))
    };
    let is_list = bytes.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'[');
    let scene = match is_list {
        true => JsonScene {
            convention: String::new(),
            width: None,
            height: None,
            k: None,
            frames: serde_json::from_slice(bytes).map_err(fault)?,
        },
        false => serde_json::from_slice(bytes).map_err(fault)?,
    };
    let entries = scene.frames.iter().map(|frame| entry(frame, &scene)).collect::<Result<_, _>>()?;
    Ok(CameraFile::new("cameras.json", entries))
}

fn entry(frame: &JsonFrame, scene: &JsonScene) -> Result<Entry, Fault> {
    let name = &frame.image;
    let missing = |what: &str| Fault::text(format!("frame {name}: {what} is missing"));
    let camera_from_world = match (&frame.camera_from_world, &frame.r, frame.c) {
        (Some(rows), ..) => pose_from_rows(name, &rows.flat())?,
        (None, Some(r), Some(c)) => {
            let rotation = rotation_from_rows(&exactly(&r.flat(), "R")?);
            rigid(name, rotation, -(rotation * DVec3::from_array(c)))?
        }
        _ => return Err(missing("camera_from_world (or R and C)")),
    };
    let k = frame.k.as_ref().or(scene.k.as_ref()).ok_or_else(|| missing("K"))?;
    let k: [f64; 9] = exactly(&k.flat(), "K")?;
    // "Pixel centres at integer coordinates", in whichever words.
    let shift = if scene.convention.to_lowercase().contains("integer") { 0.5 } else { 0.0 };
    let intrinsics = Intrinsics { fx: k[0], fy: k[4], cx: k[2] + shift, cy: k[5] + shift };
    let size = frame.width.or(scene.width).zip(frame.height.or(scene.height));
    let size = size.ok_or_else(|| missing("width or height (of the image that K is for)"))?;
    let lens = frame.distortion.as_ref().map_or(Lens::None, |d| Lens::perspective(Polynomial::opencv(d)));
    let entry = Entry::new(name, Calibration::Sized(intrinsics, size), camera_from_world);
    Ok(Entry { lens, mask: frame.mask.clone(), near_far: frame.near.zip(frame.far), ..entry })
}
