//! An sRGB picture, or a map of bytes, as an 8-bit PNG.

use super::png_file::write_png;
use png::{BitDepth, ColorType};
use std::io::{self, Write};
use surfel_core::Grid;

/// Writes values in \[0, 1\].
///
/// # Errors
/// When the picture is empty or `out` refuses.
pub fn write_rgb_png(out: &mut impl Write, picture: &Grid<[f32; 3]>) -> io::Result<()> {
    let byte = |v: &f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let bytes: Vec<u8> = picture.as_slice().iter().flatten().map(byte).collect();
    write_png(out, (picture.width(), picture.height()), (ColorType::Rgb, BitDepth::Eight), &bytes, &[])
}

/// Writes bytes as they are: masks, labels.
///
/// # Errors
/// When the map is empty or `out` refuses.
pub fn write_gray_png(out: &mut impl Write, map: &Grid<u8>) -> io::Result<()> {
    write_png(out, (map.width(), map.height()), (ColorType::Grayscale, BitDepth::Eight), map.as_slice(), &[])
}
