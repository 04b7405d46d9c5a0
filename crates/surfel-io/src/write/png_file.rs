//! PNG with text chunks, the one door to the codec. Invariant: what a picture means (unit, frame) travels
//! inside it.

use super::error::unfit;
use png::{BitDepth, ColorType, Encoder};
use std::io::{self, Write};

/// Encodes `bytes` (rows top to bottom, 16-bit samples big endian) with `(keyword, text)` pairs.
pub(super) fn write_png(
    out: &mut impl Write,
    (width, height): (usize, usize),
    (colour, depth): (ColorType, BitDepth),
    bytes: &[u8],
    texts: &[(&str, &str)],
) -> io::Result<()> {
    let side = |pixels: usize| {
        u32::try_from(pixels)
            .ok()
            .filter(|&side| side > 0)
            .ok_or_else(|| unfit(format!("a PNG cannot be {width}x{height} pixels")))
    };
    let mut encoder = Encoder::new(out, side(width)?, side(height)?);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    for (keyword, text) in texts {
        encoder.add_text_chunk((*keyword).to_owned(), (*text).to_owned())?;
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()?;
    Ok(())
}
