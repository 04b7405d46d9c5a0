//! Views of any size brought to one: scaled until they cover it, then cropped around the centre (spec 4.6).
//!
//! The photograph is shrunk by area and not by Lanczos' kernel, as photographs are when a scene is reconstructed; depth,
//! normals and masks take the nearest value. Invariant: camera and pixels stay together, so a point seen before and
//! after lies on the same spot of the picture, up to half a pixel of the maps' nearest value.

use crate::map_resample::nearest;
use crate::{DataError, TrainingView};
use surfel_io::photo::resized_picture;

/// Widest field of view of a photograph to train on, degrees.
const MAX_FIELD_OF_VIEW: f64 = 100.0;

/// The view at `width` x `height` pixels.
///
/// # Errors
/// [`DataError::TooSmall`] when it would have to be enlarged.
pub fn fitted(view: &TrainingView, width: usize, height: usize) -> Result<TrainingView, DataError> {
    let (from_width, from_height) = (view.image.width(), view.image.height());
    if width > from_width || height > from_height || width == 0 || height == 0 {
        return Err(DataError::TooSmall {
            view: view.name.clone(),
            width: from_width,
            height: from_height,
            wanted_width: width,
            wanted_height: height,
        });
    }
    let scale = (width as f64 / from_width as f64).max(height as f64 / from_height as f64);
    let scaled = |length: usize, least: usize| ((length as f64 * scale).round() as usize).max(least);
    let (scaled_width, scaled_height) = (scaled(from_width, width), scaled(from_height, height));
    let view = rescaled(view, scaled_width, scaled_height);
    Ok(cropped(&view, (scaled_width - width) / 2, (scaled_height - height) / 2, width, height))
}

/// The same picture resampled.
fn rescaled(view: &TrainingView, width: usize, height: usize) -> TrainingView {
    if (width, height) == (view.image.width(), view.image.height()) {
        return view.clone();
    }
    TrainingView {
        name: view.name.clone(),
        image: resized_picture(&view.image, width, height),
        camera: view.camera.resized(width, height),
        depth: view.depth.as_ref().map(|map| nearest(map, width, height)),
        normal: view.normal.as_ref().map(|map| nearest(map, width, height)),
        mask: view.mask.as_ref().map(|map| nearest(map, width, height)),
    }
}

/// The rectangle with top-left pixel `(x0, y0)`.
///
/// # Panics
/// If it does not lie inside.
pub fn cropped(view: &TrainingView, x0: usize, y0: usize, width: usize, height: usize) -> TrainingView {
    TrainingView {
        name: view.name.clone(),
        image: view.image.cropped(x0, y0, width, height),
        camera: view.camera.cropped(x0 as isize, y0 as isize, width, height),
        depth: view.depth.as_ref().map(|map| map.cropped(x0, y0, width, height)),
        normal: view.normal.as_ref().map(|map| map.cropped(x0, y0, width, height)),
        mask: view.mask.as_ref().map(|map| map.cropped(x0, y0, width, height)),
    }
}

/// Refuses views that see more than 100 degrees in either direction.
///
/// # Errors
/// [`DataError::TooWide`].
pub fn check_field_of_view(view: &TrainingView) -> Result<(), DataError> {
    let camera = &view.camera;
    let angle = |length: usize, focal: f64| 2.0 * (length as f64 / (2.0 * focal)).atan().to_degrees();
    let k = &camera.intrinsics;
    let degrees = angle(camera.width, k.fx).max(angle(camera.height, k.fy));
    if degrees > MAX_FIELD_OF_VIEW {
        return Err(DataError::TooWide { view: view.name.clone(), degrees, most: MAX_FIELD_OF_VIEW });
    }
    Ok(())
}
