//! Normals as an 8-bit RGB PNG: channel = n * 0.5 + 0.5, black = none.
//!
//! Camera frame, OpenCV axes, facing the camera (n_z < 0); the text chunk `Description` says so. Invariant:
//! no unit vector encodes as black.

use super::png_file::write_png;
use png::{BitDepth, ColorType};
use std::io::{self, Write};
use surfel_core::Grid;

const MEANING: &str = "n = rgb / 255 * 2 - 1; camera frame, X right, Y down, Z forward; black = none";

/// Writes unit normals of the camera frame; the zero vector means none.
///
/// # Errors
/// When the map is empty or `out` refuses.
pub fn write_normal_png(out: &mut impl Write, normals: &Grid<[f32; 3]>) -> io::Result<()> {
    let bytes: Vec<u8> = normals.as_slice().iter().flat_map(|&n| encode(n)).collect();
    let size = (normals.width(), normals.height());
    write_png(out, size, (ColorType::Rgb, BitDepth::Eight), &bytes, &[("Description", MEANING)])
}

fn encode(normal: [f32; 3]) -> [u8; 3] {
    let length_sq: f32 = normal.iter().map(|n| n * n).sum();
    if !(length_sq.is_finite() && length_sq > 0.0) {
        return [0; 3];
    }
    normal.map(|n| ((n / length_sq.sqrt() * 0.5 + 0.5) * 255.0).round() as u8)
}
