//! What can go wrong with an assets folder, said to the person who made it.

use std::path::PathBuf;

/// Why an asset could not be used.
#[derive(Debug, thiserror::Error)]
pub enum AssetError {
    /// A file could not be read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A JSON file is not what is expected.
    #[error("{path} is not a valid asset list: {source}")]
    Json {
        /// The file.
        path: PathBuf,
        /// Where and why.
        source: serde_json::Error,
    },
    /// A GLB file is broken or uses a part of glTF this reader leaves out.
    #[error("{path} cannot be used as a mesh: {problem}")]
    Glb {
        /// The file.
        path: PathBuf,
        /// A sentence about the first problem found.
        problem: String,
    },
    /// A picture could not be decoded.
    #[error("{path} cannot be decoded as an image: {source}")]
    Image {
        /// The file, or the GLB that embeds it.
        path: PathBuf,
        /// What the decoder said.
        source: image::ImageError,
    },
    /// A list that must not be empty is.
    #[error("{path} names no {what}; a scene cannot be put together without one")]
    Empty {
        /// The list.
        path: PathBuf,
        /// What is missing.
        what: &'static str,
    },
    /// A name that the library does not hold.
    #[error("there is no asset named {0:?} in this split of the library")]
    Unknown(String),
}
