//! Intrinsics of a camera file brought to the pixels of the photograph that is really there.
//!
//! Two things may differ: the resolution (the file states K for another size) and the orientation (EXIF).
//! COLMAP, instant-ngp and most tools ignore the EXIF orientation, so their cameras mean the pixels *as
//! stored*, and pixels are turned only when the stated size fits the turned image and not the stored
//! one. Invariant: a result is either explained by one scale factor or refused.

use super::entry::Calibration;
use crate::photo::swaps_axes;
use image::metadata::Orientation;
use surfel_core::Intrinsics;

/// Intrinsics for an image file.
#[derive(Clone, Debug)]
pub(super) struct Resolved {
    pub intrinsics: Intrinsics,
    pub width: usize,
    pub height: usize,
    /// What to do to the stored pixels.
    pub orientation: Orientation,
    /// What had to be assumed; the same sentence for all frames it holds for.
    pub notes: Vec<String>,
}

/// The size that the intrinsics seem to be for, when nothing explains it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Unexplained(pub (usize, usize));

/// Fits a calibration to a file of `stored` pixels with an EXIF `orientation`.
pub(super) fn resolve(
    calibration: Calibration,
    stored: (usize, usize),
    orientation: Orientation,
) -> Result<Resolved, Unexplained> {
    let turned = if swaps_axes(orientation) { (stored.1, stored.0) } else { stored };
    let stated = match calibration {
        Calibration::Sized(_, size) => Some(size),
        Calibration::Unsized(k) => {
            Some(((2.0 * k.cx).round().max(1.0) as usize, (2.0 * k.cy).round().max(1.0) as usize))
        }
        _ => None,
    };
    let is_turned = stated.is_some_and(|stated| match calibration {
        Calibration::Sized(..) => !same_shape(stated, stored) && same_shape(stated, turned),
        _ => stored != turned && (stated.0 > stated.1) != (stored.0 > stored.1) && stated.0 != stated.1,
    });
    let (width, height) = if is_turned { turned } else { stored };
    let mut notes = Vec::new();
    if is_turned {
        notes.push("the cameras are for the photographs as the EXIF orientation shows them: pixels turned".to_owned());
    } else if orientation != Orientation::NoTransforms {
        notes.push("the EXIF orientation is ignored, because the cameras are for the pixels as stored".to_owned());
    }
    let intrinsics = match calibration {
        Calibration::Sized(k, stated) => {
            if !same_shape(stated, (width, height)) {
                return Err(Unexplained(stated));
            }
            if stated != (width, height) {
                notes.push(rescaled_note(stated, (width, height)));
            }
            scaled(k, width as f64 / stated.0 as f64, height as f64 / stated.1 as f64)
        }
        Calibration::Unsized(k) => fit_unsized(k, (width, height), &mut notes)?,
        Calibration::Normalised(k) => scaled(k, width as f64, height as f64),
        Calibration::FieldOfView(angle) => {
            let focal = 0.5 * width as f64 / (0.5 * angle).tan();
            Intrinsics { fx: focal, fy: focal, cx: 0.5 * width as f64, cy: 0.5 * height as f64 }
        }
    };
    let orientation = if is_turned { orientation } else { Orientation::NoTransforms };
    Ok(Resolved { intrinsics, width, height, orientation, notes })
}

/// Equal up to one scale factor and rounding to whole pixels.
fn same_shape(stated: (usize, usize), actual: (usize, usize)) -> bool {
    let [sw, sh, aw, ah] = [stated.0, stated.1, actual.0, actual.1].map(|length| length as f64);
    (sw * ah / sh - aw).abs() <= 1.5 || (sh * aw / sw - ah).abs() <= 1.5
}

fn rescaled_note(stated: (usize, usize), actual: (usize, usize)) -> String {
    let factor = actual.0 as f64 / stated.0 as f64;
    let (sw, sh, aw, ah) = (stated.0, stated.1, actual.0, actual.1);
    format!("the cameras are for images of {sw}x{sh}, these have {aw}x{ah}: intrinsics rescaled by {factor:.4}")
}

fn scaled(k: Intrinsics, sx: f64, sy: f64) -> Intrinsics {
    Intrinsics { fx: k.fx * sx, fy: k.fy * sy, cx: k.cx * sx, cy: k.cy * sy }
}

/// Without a stated size, twice the principal point is the only hint of it.
fn fit_unsized(k: Intrinsics, actual: (usize, usize), notes: &mut Vec<String>) -> Result<Intrinsics, Unexplained> {
    let stated = ((2.0 * k.cx).round().max(1.0) as usize, (2.0 * k.cy).round().max(1.0) as usize);
    let (rx, ry) = (actual.0 as f64 / (2.0 * k.cx), actual.1 as f64 / (2.0 * k.cy));
    let near_one = |ratio: f64| (0.75..=1.34).contains(&ratio);
    if near_one(rx) && near_one(ry) {
        return Ok(k);
    }
    let whole_factor = |ratio: f64| if ratio > 1.0 { ratio.round() } else { 1.0 / (1.0 / ratio).round() };
    let factor = whole_factor((rx * ry).sqrt());
    let explained = |ratio: f64| (ratio / factor - 1.0).abs() < 0.1;
    if factor != 1.0 && explained(rx) && explained(ry) {
        notes.push(format!(
            "the principal point is that of an image of about {}x{}, these have {}x{}: intrinsics rescaled by {factor}",
            stated.0, stated.1, actual.0, actual.1
        ));
        return Ok(scaled(k, factor, factor));
    }
    let inside = |c: f64, length: usize| c > 0.0 && c < length as f64;
    if inside(k.cx, actual.0) && inside(k.cy, actual.1) {
        notes.push("the principal point is far from the middle of the image; taken as it is (a crop?)".to_owned());
        return Ok(k);
    }
    Err(Unexplained(stated))
}

#[cfg(test)]
mod tests {
    use super::*;

    const K: Intrinsics = Intrinsics { fx: 1000.0, fy: 1010.0, cx: 505.0, cy: 390.0 };

    fn resolved(calibration: Calibration, stored: (usize, usize), orientation: Orientation) -> Resolved {
        resolve(calibration, stored, orientation).unwrap()
    }

    #[test]
    fn a_stated_size_explains_another_resolution_or_nothing_does() {
        let half = resolved(Calibration::Sized(K, (1000, 800)), (500, 400), Orientation::NoTransforms);
        assert_eq!((half.intrinsics.fx, half.intrinsics.cy), (500.0, 195.0));
        assert!(half.notes[0].contains("1000x800") && half.notes[0].contains("500x400"));
        let odd = resolve(Calibration::Sized(K, (1000, 800)), (500, 500), Orientation::NoTransforms);
        assert_eq!(odd.unwrap_err(), Unexplained((1000, 800)));
    }

    #[test]
    fn an_unstated_size_is_inferred_from_the_principal_point_by_whole_factors() {
        let same = resolved(Calibration::Unsized(K), (1000, 800), Orientation::NoTransforms);
        assert!(same.notes.is_empty() && same.intrinsics == K);
        let four = resolved(Calibration::Unsized(K), (4000, 3200), Orientation::NoTransforms);
        assert_eq!(four.intrinsics.fx, 4000.0);
        let quarter = resolved(Calibration::Unsized(K), (250, 200), Orientation::NoTransforms);
        assert_eq!(quarter.intrinsics.cx, 126.25);
        assert!(resolve(Calibration::Unsized(K), (250, 700), Orientation::NoTransforms).is_err());
    }

    #[test]
    fn pixels_are_turned_only_for_cameras_of_the_turned_image() {
        let colmap = resolved(Calibration::Sized(K, (1000, 800)), (1000, 800), Orientation::Rotate90);
        assert_eq!((colmap.orientation, colmap.width), (Orientation::NoTransforms, 1000));
        assert!(colmap.notes[0].contains("ignored"));
        let viewer = resolved(Calibration::Sized(K, (1000, 800)), (800, 1000), Orientation::Rotate90);
        assert_eq!((viewer.orientation, viewer.width, viewer.height), (Orientation::Rotate90, 1000, 800));
        assert_eq!(viewer.intrinsics, K);
        let upside_down = resolved(Calibration::Sized(K, (1000, 800)), (1000, 800), Orientation::Rotate180);
        assert_eq!(upside_down.orientation, Orientation::NoTransforms);
    }

    #[test]
    fn a_field_of_view_spans_the_width() {
        let angle = 2.0 * (0.5f64).atan();
        let fov = resolved(Calibration::FieldOfView(angle), (800, 600), Orientation::NoTransforms);
        assert!((fov.intrinsics.fx - 800.0).abs() < 1e-9 && fov.intrinsics.cy == 300.0);
    }
}
