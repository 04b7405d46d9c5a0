//! Depth maps of other programs: 16-bit PNG with a unit, and PFM.
//!
//! Result in both cases: z-depth as stored, 0.0 where there is none (also for NaN, infinity and
//! negative values in the file).

use crate::photo::ImageError;
use std::path::Path;
use surfel_core::Grid;

/// Depth from a 16-bit gray PNG whose values count in `unit` (0.001 for millimetres in a metric scene).
///
/// # Errors
/// [`ImageError`] when the file is missing, damaged or not 16-bit gray.
pub fn read_depth_png16(path: &Path, unit: f64) -> Result<Grid<f32>, ImageError> {
    depth_of(crate::photo::decode(path)?, path, unit)
}

/// As [`read_depth_png16`], for a file in memory; `name` is for messages.
///
/// # Errors
/// As [`read_depth_png16`].
pub fn decode_depth_png16(bytes: &[u8], name: &Path, unit: f64) -> Result<Grid<f32>, ImageError> {
    depth_of(crate::photo::decode_bytes(bytes, name)?, name, unit)
}

fn depth_of(picture: image::DynamicImage, path: &Path, unit: f64) -> Result<Grid<f32>, ImageError> {
    match picture {
        image::DynamicImage::ImageLuma16(pixels) => {
            let (width, height) = (pixels.width() as usize, pixels.height() as usize);
            let depth = pixels.into_raw().into_iter().map(|value| (f64::from(value) * unit) as f32).collect();
            Ok(Grid::from_vec(width, height, depth))
        }
        other => Err(ImageError::decode(path, format!("is {:?}, not a 16-bit gray depth map", other.color()))),
    }
}

/// A one-channel PFM ("Pf"), either byte order; row 0 of the result is the top row.
///
/// # Errors
/// [`ImageError`] when the file is missing, damaged or has three channels.
pub fn read_pfm(path: &Path) -> Result<Grid<f32>, ImageError> {
    let bytes = std::fs::read(path).map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
    parse_pfm(&bytes).map_err(|reason| ImageError::decode(path, reason))
}

fn parse_pfm(bytes: &[u8]) -> Result<Grid<f32>, String> {
    let mut rest = bytes;
    let mut token = || -> Result<&str, String> {
        let start = rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rest.len());
        let len = rest[start..].iter().position(u8::is_ascii_whitespace);
        let len = len.ok_or("ends inside its header")?;
        let (word, tail) = rest[start..].split_at(len);
        rest = &tail[1..];
        std::str::from_utf8(word).map_err(|_| "has a header that is not text".into())
    };
    match token()? {
        "Pf" => {}
        "PF" => return Err("has three channels (PF); a depth map has one (Pf)".into()),
        _ => return Err("is not a PFM file".into()),
    }
    let mut parsed = |what: &str| -> Result<f64, String> {
        let word = token()?;
        word.parse().map_err(|_| format!("has {word:?} for its {what}"))
    };
    let (width, height, scale) = (parsed("width")?, parsed("height")?, parsed("scale")?);
    let fits = width >= 1.0 && height >= 1.0 && 4.0 * width * height <= rest.len() as f64;
    if !fits || width.fract() != 0.0 || height.fract() != 0.0 {
        return Err(format!("is cut short: {width} x {height} pixels do not fit in {} bytes", rest.len()));
    }
    let (width, height) = (width as usize, height as usize);
    let value = |x: usize, y: usize| {
        // PFM stores the bottom row first; a negative scale means little endian.
        let at = 4 * ((height - 1 - y) * width + x);
        let word = [rest[at], rest[at + 1], rest[at + 2], rest[at + 3]];
        let depth = if scale < 0.0 { f32::from_le_bytes(word) } else { f32::from_be_bytes(word) };
        if depth.is_finite() && depth > 0.0 { depth } else { 0.0 }
    };
    Ok(Grid::from_fn(width, height, value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn pfm_is_bottom_up_in_either_byte_order_and_holes_are_zero() {
        let rows_bottom_up = [3.0f32, f32::INFINITY, 1.0, f32::NAN];
        let expected = Grid::from_vec(2, 2, vec![1.0, 0.0, 3.0, 0.0]);
        let mut little = b"Pf\n2 2\n-1.0\n".to_vec();
        rows_bottom_up.iter().for_each(|v| little.extend(v.to_le_bytes()));
        let mut big = b"Pf\n2 2\n1.0\n".to_vec();
        rows_bottom_up.iter().for_each(|v| big.extend(v.to_be_bytes()));
        assert_eq!(parse_pfm(&little).unwrap(), expected);
        assert_eq!(parse_pfm(&big).unwrap(), expected);
        assert!(parse_pfm(&little[..20]).unwrap_err().contains("cut short"));
        assert!(parse_pfm(b"Pf\n99999999999 99999999999\n-1.0\n").unwrap_err().contains("cut short"));
    }

    proptest! {
        #[test]
        fn any_bytes_are_an_error_and_never_a_panic(tail in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = parse_pfm(&tail);
            let _ = parse_pfm(&[b"Pf 3 3 -1 ", &tail[..]].concat());
        }
    }
}
