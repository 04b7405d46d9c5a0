//! Depth as a 16-bit grey PNG: depth = count * unit, 0 = none.
//!
//! The unit is recorded twice, inside the picture (text `DepthUnit`) and in a JSON sidecar. Invariant: a
//! valid depth never becomes count 0.

use super::png_file::write_png;
use png::{BitDepth, ColorType};
use serde::Serialize;
use std::io::{self, Write};
use surfel_core::Grid;

/// The smallest of 1, 2, 5 times a power of ten for which `max_depth` fits 16 bits; scene units per count.
/// Take the maximum over all views of a scene so that they share one unit.
pub fn depth_png_unit(max_depth: f32) -> f64 {
    let least = f64::from(max_depth) / f64::from(u16::MAX);
    if !(least.is_finite() && least > 0.0) {
        return 1.0;
    }
    let exponent = least.log10().floor() as i32;
    let candidates = [1u8, 2, 5, 10].map(|digit| format!("{digit}e{exponent}").parse().unwrap_or(1.0));
    candidates.into_iter().find(|&unit: &f64| unit >= least).unwrap_or(least)
}

/// Writes z-depth in counts of `unit`; depths beyond 65535 counts are clamped.
///
/// # Errors
/// When the map is empty or `out` refuses.
pub fn write_depth_png(out: &mut impl Write, depth: &Grid<f32>, unit: f64) -> io::Result<()> {
    let count =
        |z: f32| if z.is_finite() && z > 0.0 { (f64::from(z) / unit).round().clamp(1.0, 65535.0) as u16 } else { 0 };
    let bytes: Vec<u8> = depth.as_slice().iter().flat_map(|&z| count(z).to_be_bytes()).collect();
    let texts = [("DepthUnit", format!("{unit}")), ("Description", "z-depth = count * DepthUnit, 0 = none".into())];
    let texts = texts.each_ref().map(|(keyword, text)| (*keyword, text.as_str()));
    write_png(out, (depth.width(), depth.height()), (ColorType::Grayscale, BitDepth::Sixteen), &bytes, &texts)
}

#[derive(Serialize)]
struct Sidecar {
    width: usize,
    height: usize,
    unit_per_count: f64,
    none: u16,
    kind: &'static str,
}

/// Writes the JSON that explains the PNG of the same stem.
///
/// # Errors
/// When `out` refuses.
pub fn write_depth_sidecar(out: &mut impl Write, depth: &Grid<f32>, unit: f64) -> io::Result<()> {
    let (width, height) = (depth.width(), depth.height());
    let sidecar =
        Sidecar { width, height, unit_per_count: unit, none: 0, kind: "z-depth along the optical axis, scene units" };
    serde_json::to_writer_pretty(&mut *out, &sidecar)?;
    out.write_all(b"\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_is_round_and_large_enough() {
        assert_eq!(depth_png_unit(9.7), 2e-4);
        assert_eq!(depth_png_unit(6.5), 1e-4);
        assert_eq!(depth_png_unit(905.0), 0.02);
        assert_eq!(depth_png_unit(0.0), 1.0);
        for exponent in -12..12 {
            let farthest = 3.3f32 * 10f32.powi(exponent);
            let counts = f64::from(farthest) / depth_png_unit(farthest);
            assert!((20_000.0..=65_535.0).contains(&counts), "{farthest}: {counts} counts");
        }
    }
}
