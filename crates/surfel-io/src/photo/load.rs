//! From a file to a [`View`]: decode, turn, shrink, undistort, mask.
//!
//! A pinhole photograph is resampled once, by area. A distorted one is first shrunk by area to about the
//! resolution of the result and then remapped bilinearly, so that neither step aliases. Colour and masks
//! take the same path, and so does the camera. Invariant: what is kept is of the size of the result; only
//! the decoded bytes are of the size of the photograph.

use super::resample::{FloatRaster, Pixels, Raster};
use super::{ImageError, decode, swaps_axes};
use crate::scene::Frame;
use image::DynamicImage;
use rayon::prelude::*;
use std::path::Path;
use surfel_core::{Camera, Grid, View};

/// A pixel counts as masked out when less than half of its area is inside the mask.
const INSIDE: f32 = 0.5;

impl Frame {
    /// Reads the photograph as a pinhole view of `width` x `height` pixels.
    ///
    /// The camera is [`Frame::pinhole`] resized; pixels outside the mask (file or alpha channel) or outside
    /// the undistorted field of view are not valid.
    ///
    /// # Errors
    /// [`ImageError`], naming the file: missing, damaged, too large, changed in size, or masked entirely.
    ///
    /// # Panics
    /// If `width` or `height` is 0.
    pub fn load(&self, width: usize, height: usize) -> Result<View, ImageError> {
        assert!(width > 0 && height > 0, "a view needs at least one pixel");
        let full = self.pinhole();
        let (sx, sy) = (width as f64 / full.width as f64, height as f64 / full.height as f64);
        let shrunk = |length: usize, scale: f64| ((length as f64 * scale).round() as usize).clamp(1, length);
        // Without distortion the photograph goes to its final size at once, also when that is larger.
        let size = match self.lens.is_none() {
            true => (width, height),
            false => (shrunk(self.width, sx), shrunk(self.height, sy)),
        };
        let mut colour = self.colour(size)?;
        let mask = self.mask(size)?;
        let camera = full.resized(width, height);
        let mut seen = vec![true; width * height];
        let mut coverage = mask;
        if !self.lens.is_none() {
            let map = self.remap(&camera);
            colour = remapped(&colour, &map, (width, height), self);
            coverage = coverage.map(|mask| remapped(&mask, &map, (width, height), self));
            seen = map.iter().map(Option::is_some).collect();
        }
        let alpha = colour.channels == 4;
        let masked = |index: usize| {
            let by_alpha = !alpha || colour.values[4 * index + 3] >= INSIDE;
            by_alpha && coverage.as_ref().is_none_or(|mask| mask.values[index] >= INSIDE)
        };
        let valid: Vec<bool> = seen.iter().enumerate().map(|(index, &seen)| seen && masked(index)).collect();
        if (alpha || coverage.is_some()) && !valid.contains(&true) {
            let mask = self.mask_path.clone().unwrap_or_else(|| self.image_path.clone());
            return Err(ImageError::EmptyMask { image: self.image_path.clone(), mask });
        }
        let pixel = |p: &[f32]| if colour.channels < 3 { [p[0]; 3] } else { [p[0], p[1], p[2]] };
        let image = colour.values.chunks_exact(colour.channels).map(pixel).collect();
        Ok(View {
            name: self.stem(),
            image: Grid::from_vec(width, height, image),
            valid: Grid::from_vec(width, height, valid),
            camera,
        })
    }

    fn colour(&self, (width, height): (usize, usize)) -> Result<FloatRaster, ImageError> {
        let mut image = decode(&self.image_path)?;
        image.apply_orientation(self.orientation);
        if (image.width() as usize, image.height() as usize) != (self.width, self.height) {
            let (w, h, was_w, was_h) = (image.width(), image.height(), self.width, self.height);
            let reason = format!("has {w}x{h} pixels, but had {was_w}x{was_h} when the scene was opened");
            return Err(ImageError::decode(&self.image_path, reason));
        }
        Ok(raster(image).resized(width, height))
    }

    fn mask(&self, (width, height): (usize, usize)) -> Result<Option<FloatRaster>, ImageError> {
        let Some(path) = &self.mask_path else { return Ok(None) };
        let mut mask = decode(path)?;
        let is_turned = (mask.width() < mask.height()) == (self.width < self.height);
        // A mask drawn over the stored pixels turns with them; one drawn over the turned picture is right already.
        if !swaps_axes(self.orientation) || !is_turned {
            mask.apply_orientation(self.orientation);
        }
        self.check_mask_shape(path, &mask)?;
        Ok(Some(raster(mask_values(mask)).resized(width, height)))
    }

    fn check_mask_shape(&self, path: &Path, mask: &DynamicImage) -> Result<(), ImageError> {
        let (mw, mh) = (f64::from(mask.width()), f64::from(mask.height()));
        let (w, h) = (self.width as f64, self.height as f64);
        if (mw * h / mh - w).abs() / w < 0.02 {
            return Ok(());
        }
        let reason = format!(
            "the mask has {mw}x{mh} pixels, which is no scaled copy of the {w}x{h} of its photograph; draw it over the photograph itself"
        );
        Err(ImageError::decode(path, reason))
    }

    /// Where each pixel of `camera` lies in the photograph, continuous, row by row.
    fn remap(&self, camera: &Camera) -> Vec<Option<[f32; 2]>> {
        let radius = self.lens.radius_of_validity();
        let pixel = |index: usize| {
            let ray = camera.ray(Camera::pixel_centre(index % camera.width, index / camera.width));
            self.source_pixel(ray.truncate(), radius).map(|pixel| [pixel.x as f32, pixel.y as f32])
        };
        (0..camera.width * camera.height).into_par_iter().map(pixel).collect()
    }
}

/// Samples a shrunk photograph at full-resolution positions; blanks are black.
fn remapped(
    from: &FloatRaster,
    map: &[Option<[f32; 2]>],
    (width, height): (usize, usize),
    frame: &Frame,
) -> FloatRaster {
    let (sx, sy) = (from.width as f64 / frame.width as f64, from.height as f64 / frame.height as f64);
    let channels = from.channels;
    let mut values = vec![0.0; width * height * channels];
    values.par_chunks_exact_mut(channels).zip(map).for_each(|(out, position)| {
        if let Some([x, y]) = position {
            from.sample(f64::from(*x) * sx, f64::from(*y) * sy, out);
        }
    });
    FloatRaster { width, height, channels, values }
}

fn raster(image: DynamicImage) -> Raster {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let (channels, pixels) = match image {
        DynamicImage::ImageLuma8(pixels) => (1, Pixels::Bits8(pixels.into_raw())),
        DynamicImage::ImageRgb8(pixels) => (3, Pixels::Bits8(pixels.into_raw())),
        DynamicImage::ImageRgba8(pixels) => (4, Pixels::Bits8(pixels.into_raw())),
        DynamicImage::ImageLuma16(pixels) => (1, Pixels::Bits16(pixels.into_raw())),
        DynamicImage::ImageRgb16(pixels) => (3, Pixels::Bits16(pixels.into_raw())),
        DynamicImage::ImageRgba16(pixels) => (4, Pixels::Bits16(pixels.into_raw())),
        other if other.color().has_alpha() => (4, Pixels::Bits8(other.into_rgba8().into_raw())),
        other => (3, Pixels::Bits8(other.into_rgb8().into_raw())),
    };
    Raster { width, height, channels, pixels }
}

/// One channel: the alpha of a mask that has one with something in it, its brightness otherwise.
fn mask_values(mask: DynamicImage) -> DynamicImage {
    if !mask.color().has_alpha() {
        return DynamicImage::ImageLuma8(mask.into_luma8());
    }
    let rgba = mask.into_rgba8();
    let by_alpha = rgba.pixels().any(|pixel| pixel.0[3] < 255);
    let values = image::ImageBuffer::from_fn(rgba.width(), rgba.height(), |x, y| {
        let [r, g, b, alpha] = rgba.get_pixel(x, y).0;
        image::Luma([if by_alpha { alpha } else { r.max(g).max(b) }])
    });
    DynamicImage::ImageLuma8(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_with_an_opaque_alpha_is_read_by_its_brightness() {
        let mask = |alpha: u8| {
            let pixels = image::RgbaImage::from_raw(2, 1, vec![255, 255, 255, 255, 0, 0, 0, alpha]);
            mask_values(DynamicImage::ImageRgba8(pixels.unwrap())).into_luma8().into_raw()
        };
        assert_eq!(mask(255), [255, 0]);
        assert_eq!(mask(0), [255, 0]);
    }
}
