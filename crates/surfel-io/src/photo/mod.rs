//! Photographs: their headers when a scene is opened, their pixels when a view is needed.
//!
//! Invariant: no photograph is decoded whose header promises more than [`MAX_SIDE`] or [`MAX_PIXELS`].

mod jpeg;
mod load;
mod picture;
mod pinhole;
mod resample;

pub use picture::{decode_picture, read_picture, resized_picture};

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageReader};
use std::io::{BufRead, Cursor, Read, Seek};
use std::path::{Path, PathBuf};

/// The longest side that is decoded, pixels.
pub const MAX_SIDE: usize = 16_384;
/// The largest photograph that is decoded, pixels.
pub const MAX_PIXELS: usize = 200_000_000;
/// Decoders may not take more memory than this.
const MAX_DECODER_BYTES: u64 = 1 << 30;

/// Enough of a JPEG to hold its EXIF block and its size in nearly all cases.
const HEADER_BYTES: u64 = 256 * 1024;

/// Why an image could not be read.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The file could not be opened or read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is damaged or of an unknown kind.
    #[error("{}: {reason}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The image would not fit in memory.
    #[error("{} has {width} x {height} pixels, more than the {MAX_SIDE} a side or {} million that are read; make a smaller copy (the cameras are rescaled by themselves)", path.display(), MAX_PIXELS / 1_000_000)]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// The mask covers the whole photograph.
    #[error("the mask of {} ({}) leaves no pixel of it; white must show what to reconstruct", image.display(), mask.display())]
    EmptyMask {
        /// The photograph.
        image: PathBuf,
        /// The mask file, or the photograph itself for an alpha channel.
        mask: PathBuf,
    },
}

impl ImageError {
    pub(crate) fn decode(path: &Path, reason: impl Into<String>) -> Self {
        Self::Decode { path: path.to_owned(), reason: reason.into() }
    }

    fn from_decoder(path: &Path, error: &image::ImageError) -> Self {
        // Some decoders end their sentence with a line break.
        let said = error.to_string();
        Self::decode(path, format!("the image cannot be decoded ({}); is the file complete?", said.trim()))
    }
}

/// What the header of an image file says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Header {
    /// Columns as stored.
    pub width: usize,
    /// Rows as stored.
    pub height: usize,
    /// The EXIF orientation.
    pub orientation: Orientation,
}

/// True when an orientation exchanges width and height.
pub(crate) fn swaps_axes(orientation: Orientation) -> bool {
    matches!(
        orientation,
        Orientation::Rotate90 | Orientation::Rotate270 | Orientation::Rotate90FlipH | Orientation::Rotate270FlipH
    )
}

/// Reads size and orientation without decoding pixels.
pub(crate) fn read_header(path: &Path) -> Result<Header, ImageError> {
    let fault = |source| ImageError::Read { path: path.to_owned(), source };
    let mut file = std::fs::File::open(path).map_err(fault)?;
    let mut bytes = Vec::new();
    file.by_ref().take(HEADER_BYTES).read_to_end(&mut bytes).map_err(fault)?;
    // The JPEG decoder wants the whole file in memory; its beginning nearly always suffices.
    if let Ok(header) = header_of(Cursor::new(&bytes)) {
        return Ok(header);
    }
    file.read_to_end(&mut bytes).map_err(fault)?;
    header_of(Cursor::new(&bytes)).map_err(|error| ImageError::from_decoder(path, &error))
}

fn header_of(reader: impl BufRead + Seek) -> Result<Header, image::ImageError> {
    let mut decoder = ImageReader::new(reader).with_guessed_format()?.into_decoder()?;
    let (width, height) = decoder.dimensions();
    // A damaged EXIF block is no reason to refuse the picture.
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    Ok(Header { width: width as usize, height: height as usize, orientation })
}

/// Decodes the pixels as stored.
pub(crate) fn decode(path: &Path) -> Result<DynamicImage, ImageError> {
    check_size(read_header(path)?, path)?;
    let bytes = std::fs::read(path).map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
    decode_bytes(&bytes, path)
}

/// Decodes the pixels of a file in memory; `path` is for messages.
pub(crate) fn decode_bytes(bytes: &[u8], path: &Path) -> Result<DynamicImage, ImageError> {
    let header = header_of(Cursor::new(bytes)).map_err(|error| ImageError::from_decoder(path, &error))?;
    check_size(header, path)?;
    if !jpeg::is_complete(bytes) {
        return Err(ImageError::decode(path, "the image is cut short; copy the file again"));
    }
    let fault = |source| ImageError::Read { path: path.to_owned(), source };
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(fault)?;
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MAX_DECODER_BYTES);
    reader.limits(limits);
    reader.decode().map_err(|error| ImageError::from_decoder(path, &error))
}

fn check_size(Header { width, height, .. }: Header, path: &Path) -> Result<(), ImageError> {
    if width > MAX_SIDE || height > MAX_SIDE || width * height > MAX_PIXELS {
        return Err(ImageError::TooLarge { path: path.to_owned(), width, height });
    }
    Ok(())
}
