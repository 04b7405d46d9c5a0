//! Why training data cannot be used, said to the person who has them.
//!
//! Invariant: every message names a file or folder, and the scene and view where there is one.

use std::path::PathBuf;
use surfel_core::rigid::NotRigid;
use surfel_io::{ImageError, SceneError};
use surfel_torch::TorchError;

/// Why training data cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// A file or folder could not be read at all.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file does not hold what its layout promises, or the layout is not there.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A chunk that is no plain PyTorch file.
    #[error(transparent)]
    Torch(#[from] TorchError),
    /// A photograph or map that cannot be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A camera file that cannot be read.
    #[error(transparent)]
    Camera(#[from] SceneError),
    /// A pose is not a rotation and a translation.
    #[error("{}: {view}: {source}; leave the scene out", path.display())]
    Pose {
        /// The file.
        path: PathBuf,
        /// The scene and the frame.
        view: String,
        /// What is wrong with the matrix.
        source: NotRigid,
    },
    /// A view that is too small for the size asked for.
    #[error(
        "view {view} has {width} x {height} pixels, too few for {wanted_width} x {wanted_height}; ask for a smaller size"
    )]
    TooSmall {
        /// The view.
        view: String,
        /// Its columns.
        width: usize,
        /// Its rows.
        height: usize,
        /// Columns asked for.
        wanted_width: usize,
        /// Rows asked for.
        wanted_height: usize,
    },
    /// A view whose field of view is wider than a pinhole should have.
    #[error("view {view} sees {degrees:.0} degrees, more than {most:.0}; leave the scene out")]
    TooWide {
        /// The view.
        view: String,
        /// The larger of its two fields of view.
        degrees: f64,
        /// The most that is used.
        most: f64,
    },
}

impl DataError {
    pub(crate) fn malformed(path: impl Into<PathBuf>, reason: impl Into<String>) -> Self {
        Self::Malformed { path: path.into(), reason: reason.into() }
    }
}
