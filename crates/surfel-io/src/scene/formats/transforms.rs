//! `transforms*.json` of nerfstudio, instant-ngp and the Blender scenes.
//!
//! `transform_matrix` is `world_from_camera` in OpenGL axes (X right, Y up, Z back); principal points are
//! continuous. Intrinsics may be per file or per frame, or only a field of view; `applied_transform` and
//! `applied_scale` are already in the poses. Blender's `file_path` has no extension.

use crate::scene::entry::{Calibration, CameraFile, Entry, from_opengl, pose_from_rows};
use crate::scene::error::{Fault, SceneError, read_bytes};
use serde::Deserialize;
use std::path::Path;
use surfel_core::lens::Polynomial;
use surfel_core::{Intrinsics, Lens};

pub(in crate::scene) fn read(path: &Path) -> Result<CameraFile, SceneError> {
    parse(&read_bytes(path)?).map_err(|fault| fault.in_file(path))
}

#[derive(Deserialize)]
struct Transforms {
    #[serde(flatten)]
    shared: Optics,
    frames: Vec<TransformsFrame>,
}

#[derive(Deserialize)]
struct TransformsFrame {
    file_path: String,
    transform_matrix: Vec<Vec<f64>>,
    mask_path: Option<String>,
    #[serde(flatten)]
    own: Optics,
}

/// Everything about the camera that may stand at the top or at a frame.
#[derive(Deserialize, Default)]
struct Optics {
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

pub(super) fn parse(bytes: &[u8]) -> Result<CameraFile, Fault> {
    let json: Transforms =
        serde_json::from_slice(bytes).map_err(|error| Fault::text(format!("is not a transforms file ({error})")))?;
    let entries = json.frames.iter().map(|frame| entry(frame, &json.shared)).collect::<Result<_, _>>()?;
    Ok(CameraFile::new("nerfstudio/instant-ngp transforms", entries))
}

fn entry(frame: &TransformsFrame, shared: &Optics) -> Result<Entry, Fault> {
    let name = &frame.file_path;
    let rows = frame.transform_matrix.concat();
    if frame.transform_matrix.iter().any(|row| row.len() != 4) {
        return Err(Fault::text(format!("frame {name}: transform_matrix must have rows of 4 numbers")));
    }
    let camera_from_world = from_opengl(&pose_from_rows(name, &rows)?);
    let in_frame = |fault: String| Fault::text(format!("frame {name}: {fault}"));
    let calibration = calibration(&frame.own, shared).map_err(in_frame)?;
    let lens = lens(&frame.own, shared).map_err(in_frame)?;
    let entry = Entry::new(name.trim_start_matches("./"), calibration, camera_from_world);
    Ok(Entry { lens, mask: frame.mask_path.clone(), ..entry })
}

fn calibration(own: &Optics, shared: &Optics) -> Result<Calibration, String> {
    let pick = |value: fn(&Optics) -> Option<f64>| value(own).or(value(shared));
    let focal = |length: Option<f64>, angle: Option<f64>, extent: Option<f64>| {
        length.or(angle.zip(extent).map(|(angle, extent)| 0.5 * extent / (0.5 * angle).tan()))
    };
    let (w, h) = (pick(|o| o.w), pick(|o| o.h));
    let fx = focal(pick(|o| o.fl_x), pick(|o| o.camera_angle_x), w);
    let fy = focal(pick(|o| o.fl_y), pick(|o| o.camera_angle_y), h);
    let Some((fx, fy)) = fx.or(fy).zip(fy.or(fx)) else {
        let angle = pick(|o| o.camera_angle_x).ok_or("has neither fl_x nor camera_angle_x")?;
        return Ok(Calibration::FieldOfView(angle));
    };
    let centre = |stated: Option<f64>, extent: Option<f64>| stated.or(extent.map(|extent| 0.5 * extent));
    let centre = centre(pick(|o| o.cx), w).zip(centre(pick(|o| o.cy), h));
    let (cx, cy) = centre.ok_or("has fl_x, but neither cx, cy nor w, h")?;
    let intrinsics = Intrinsics { fx, fy, cx, cy };
    match w.zip(h) {
        Some((w, h)) if w >= 1.0 && h >= 1.0 && w < 1e6 && h < 1e6 => {
            Ok(Calibration::Sized(intrinsics, (w.round() as usize, h.round() as usize)))
        }
        Some((w, h)) => Err(format!("states an image of {w} x {h} pixels")),
        None => Ok(Calibration::Unsized(intrinsics)),
    }
}

fn lens(own: &Optics, shared: &Optics) -> Result<Lens, String> {
    let pick = |value: fn(&Optics) -> Option<f64>| value(own).or(value(shared)).unwrap_or(0.0);
    let (k1, k2, k3, k4) = (pick(|o| o.k1), pick(|o| o.k2), pick(|o| o.k3), pick(|o| o.k4));
    let tangential = [pick(|o| o.p1), pick(|o| o.p2)];
    let radial = Polynomial::radial(&[k1, k2, k3, k4]);
    let model = own.camera_model.as_deref().or(shared.camera_model.as_deref());
    let fisheye = own.is_fisheye.or(shared.is_fisheye).unwrap_or(false);
    match model {
        Some("OPENCV_FISHEYE" | "fisheye") => Ok(Lens::Fisheye(radial)),
        None if fisheye => Ok(Lens::Fisheye(radial)),
        Some("PINHOLE" | "SIMPLE_PINHOLE") => Ok(Lens::None),
        // nerfstudio's k4 is the coefficient of r⁸, not OpenCV's denominator.
        None | Some("OPENCV" | "SIMPLE_RADIAL" | "RADIAL" | "perspective") => {
            Ok(Lens::perspective(Polynomial { tangential, ..radial }))
        }
        Some(other) => Err(format!("camera_model {other} is not supported; known are PINHOLE, OPENCV, OPENCV_FISHEYE")),
    }
}
