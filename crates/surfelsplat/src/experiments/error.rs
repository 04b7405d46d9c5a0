//! Why an experiment stopped, as one sentence.

use crate::reconstruct::ReconstructError;
use std::path::PathBuf;
use surfel_io::write::WriteError;
use surfel_synth::AssetError;

/// Every way an experiment can end early.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// A scene could not be drawn.
    #[error(transparent)]
    Assets(#[from] AssetError),
    /// A scene or result could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The road stopped on a scene.
    #[error("{scene}: {source}")]
    Reconstruct {
        /// Name of the scene.
        scene: String,
        /// Why.
        source: Box<ReconstructError>,
    },
    /// A file could not be read or written.
    #[error("cannot use {path}: {source}")]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// What was asked for cannot be done.
    #[error("{0}")]
    Request(String),
}
