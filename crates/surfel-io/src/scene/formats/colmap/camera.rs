//! COLMAP's camera models: which parameters mean what.
//!
//! The table follows COLMAP's `sensor/models.h`; a model outside it is refused by name.

use crate::scene::error::Fault;
use surfel_core::lens::Polynomial;
use surfel_core::{Intrinsics, Lens};

/// A camera of a COLMAP model.
#[derive(Debug)]
pub(in crate::scene::formats) struct ModelCamera {
    pub width: usize,
    pub height: usize,
    pub intrinsics: Intrinsics,
    pub lens: Lens,
}

/// Model names by COLMAP's id, with their number of parameters.
const MODELS: [(&str, usize); 11] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
];

/// Name and number of parameters of a binary model id.
pub(super) fn model_of_id(id: i32) -> Result<(&'static str, usize), Fault> {
    let known = usize::try_from(id).ok().and_then(|id| MODELS.get(id).copied());
    known.ok_or_else(|| Fault::text(format!("camera model id {id} is not supported; {}", supported())))
}

fn supported() -> String {
    let names = MODELS.map(|(name, _)| name).join(", ");
    format!("undistort the images with COLMAP (image_undistorter) or use one of {names}")
}

/// Builds a camera; too many or too few parameters are mended with a warning where that is safe.
///
/// Some exporters write parameters of another count than the model has (RealityScan does): extra ones are
/// ignored, missing distortion coefficients are zero.
pub(super) fn camera(
    id: u32,
    model: &str,
    (width, height): (u64, u64),
    parameters: &[f64],
    warnings: &mut Vec<String>,
) -> Result<ModelCamera, Fault> {
    let Some(&(model, count)) = MODELS.iter().find(|(name, _)| *name == model) else {
        return Err(Fault::text(format!("camera {id}: model {model} is not supported; {}", supported())));
    };
    let given = parameters.len();
    let single_focal =
        matches!(model, "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE");
    let num_pinhole = if single_focal { 3 } else { 4 };
    if given < num_pinhole || (given < count && model == "FOV") {
        return Err(Fault::text(format!("camera {id}: {model} needs {count} parameters, not {given}")));
    }
    if given != count {
        warnings.push(format!(
            "camera {id}: {model} has {count} parameters, but {given} are given; extra ones are ignored and missing ones taken as 0"
        ));
    }
    if !(1..1_000_000).contains(&width) || !(1..1_000_000).contains(&height) {
        return Err(Fault::text(format!("camera {id}: an image of {width} x {height} pixels")));
    }
    let p = |i: usize| parameters.get(i).copied().unwrap_or(0.0);
    let intrinsics = match single_focal {
        true => Intrinsics { fx: p(0), fy: p(0), cx: p(1), cy: p(2) },
        false => Intrinsics { fx: p(0), fy: p(1), cx: p(2), cy: p(3) },
    };
    let lens = match model {
        "SIMPLE_RADIAL" => Lens::perspective(Polynomial::radial(&[p(3)])),
        "RADIAL" => Lens::perspective(Polynomial::radial(&[p(3), p(4)])),
        "OPENCV" => Lens::perspective(Polynomial::opencv(&[p(4), p(5), p(6), p(7)])),
        "FULL_OPENCV" => Lens::perspective(Polynomial::opencv(&std::array::from_fn::<f64, 8, _>(|i| p(4 + i)))),
        "OPENCV_FISHEYE" => Lens::Fisheye(Polynomial::radial(&[p(4), p(5), p(6), p(7)])),
        "SIMPLE_RADIAL_FISHEYE" => Lens::Fisheye(Polynomial::radial(&[p(3)])),
        "RADIAL_FISHEYE" => Lens::Fisheye(Polynomial::radial(&[p(3), p(4)])),
        "FOV" => Lens::Fov { omega: p(4) },
        "THIN_PRISM_FISHEYE" => Lens::Fisheye(Polynomial {
            tangential: [p(6), p(7)],
            prism: [p(10), p(11)],
            ..Polynomial::radial(&[p(4), p(5), p(8), p(9)])
        }),
        _ => Lens::None,
    };
    Ok(ModelCamera { width: width as usize, height: height as usize, intrinsics, lens })
}
