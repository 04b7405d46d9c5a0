//! Confidence as an 8-bit grey PNG: 0 = none, 255 = certain.

use super::png_file::write_png;
use png::{BitDepth, ColorType};
use std::io::{self, Write};
use surfel_core::Grid;

/// Writes values in \[0, 1\]; others are clamped, NaN counts as 0.
///
/// # Errors
/// When the map is empty or `out` refuses.
pub fn write_confidence_png(out: &mut impl Write, confidence: &Grid<f32>) -> io::Result<()> {
    let bytes: Vec<u8> = confidence.as_slice().iter().map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
    let size = (confidence.width(), confidence.height());
    write_png(
        out,
        size,
        (ColorType::Grayscale, BitDepth::Eight),
        &bytes,
        &[("Description", "confidence = value / 255")],
    )
}
