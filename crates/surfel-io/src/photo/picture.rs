//! A picture without a camera: sRGB values of a file or of bytes, and the same picture at another size.
//!
//! For data sets, whose readers know the cameras themselves. Invariant: the limits of [`super::MAX_SIDE`] and
//! [`super::MAX_PIXELS`] hold here too, and a resized picture is what [`crate::Frame::load`] would have made.

use super::resample::resize;
use super::{ImageError, decode, decode_bytes};
use image::DynamicImage;
use std::path::Path;
use surfel_core::Grid;

/// Reads a picture; transparency is left out.
///
/// # Errors
/// [`ImageError`], naming the file.
pub fn read_picture(path: &Path) -> Result<Grid<[f32; 3]>, ImageError> {
    decode(path).map(values)
}

/// A picture in memory; `name` is for messages.
///
/// # Errors
/// [`ImageError`], with `name` in the place of the file.
pub fn decode_picture(bytes: &[u8], name: &Path) -> Result<Grid<[f32; 3]>, ImageError> {
    decode_bytes(bytes, name).map(values)
}

/// The same picture at `width` x `height` pixels: the mean of the area each new pixel covers, or interpolated where it
/// grows.
///
/// # Panics
/// If either picture has no pixels.
pub fn resized_picture(picture: &Grid<[f32; 3]>, width: usize, height: usize) -> Grid<[f32; 3]> {
    let size = (picture.width(), picture.height());
    let values = resize(picture.as_slice().as_flattened(), 3, size, (width, height), 1.0);
    Grid::from_vec(width, height, values.as_chunks().0.to_vec())
}

fn values(image: DynamicImage) -> Grid<[f32; 3]> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    Grid::from_vec(width, height, image.into_rgb32f().into_raw().as_chunks().0.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Frame;
    use image::metadata::Orientation;
    use surfel_core::{Intrinsics, Lens, Rigid};

    fn assert_close(a: &Grid<[f32; 3]>, b: &Grid<[f32; 3]>) {
        assert!(a.same_size(b));
        let pairs = a.as_slice().as_flattened().iter().zip(b.as_slice().as_flattened());
        pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-5, "{a} {b}"));
    }

    #[test]
    fn a_picture_is_what_a_frame_would_have_been() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let value = |i: usize| (i % 256) as f32 / 255.0;
        let picture = Grid::from_fn(23, 17, |x, y| [value(11 * x), value(13 * y), value(7 * x * y)]);
        let mut bytes = Vec::new();
        crate::write::picture_png::write_rgb_png(&mut bytes, &picture).unwrap();
        std::fs::write(&path, &bytes).unwrap();
        assert_close(&read_picture(&path).unwrap(), &picture);
        assert_close(&decode_picture(&bytes, &path).unwrap(), &picture);
        let frame = Frame {
            name: "a.png".to_owned(),
            image_path: path,
            mask_path: None,
            width: 23,
            height: 17,
            intrinsics: Intrinsics { fx: 20.0, fy: 20.0, cx: 11.5, cy: 8.5 },
            lens: Lens::None,
            camera_from_world: Rigid::IDENTITY,
            near_far: None,
            orientation: Orientation::NoTransforms,
        };
        for (width, height) in [(23, 17), (11, 9), (40, 30)] {
            assert_close(&frame.load(width, height).unwrap().image, &resized_picture(&picture, width, height));
        }
    }

    #[test]
    fn bytes_that_are_no_picture_are_an_error_with_their_name() {
        let error = decode_picture(b"no picture", Path::new("chunk: scene a image 3")).unwrap_err().to_string();
        assert!(error.starts_with("chunk: scene a image 3: the image cannot be decoded"), "{error}");
    }
}
