//! PFM: depth and normals as exact floats, little endian (scale -1.0), bottom row first as the format demands.

use std::io::{self, Write};
use surfel_core::Grid;

/// Writes a one-channel map; values pass through untouched (0 = no depth).
///
/// # Errors
/// When `out` refuses.
pub fn write_pfm(out: &mut impl Write, map: &Grid<f32>) -> io::Result<()> {
    write!(out, "Pf\n{} {}\n-1.0\n", map.width(), map.height())?;
    for y in (0..map.height()).rev() {
        let bytes: Vec<u8> = map.row(y).iter().flat_map(|value| value.to_le_bytes()).collect();
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// Writes a three-channel map ("PF"): normals, colours.
///
/// # Errors
/// When `out` refuses.
pub fn write_pfm_rgb(out: &mut impl Write, map: &Grid<[f32; 3]>) -> io::Result<()> {
    write!(out, "PF\n{} {}\n-1.0\n", map.width(), map.height())?;
    for y in (0..map.height()).rev() {
        let bytes: Vec<u8> = map.row(y).iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
        out.write_all(&bytes)?;
    }
    Ok(())
}
