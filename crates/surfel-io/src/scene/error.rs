//! What can be wrong with a scene, said to the person who made it.
//!
//! Parsers work on bytes and report a [`Fault`]; the reader that knows the file turns it into a
//! [`SceneError`]. Invariant: every message names a path and, where there is one, the frame.

use super::FormatKind;
use crate::photo::ImageError;
use std::path::{Path, PathBuf};
use surfel_core::rigid::NotRigid;

/// Why a scene could not be opened, or a view not be chosen from it.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A file or folder could not be read at all.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A camera file does not hold what its format promises.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// The camera file.
        path: PathBuf,
        /// What is wrong, and where in the file.
        reason: String,
    },
    /// A pose is not a rotation and a translation.
    #[error("{}: frame {frame}: {source}; correct the pose or take the frame out of the file", path.display())]
    Pose {
        /// The camera file.
        path: PathBuf,
        /// The frame, as the camera file names it.
        frame: String,
        /// What is wrong with the matrix.
        source: NotRigid,
    },
    /// No camera file was found.
    #[error("{} holds no cameras that can be read; looked for:\n{}\nPhotographs alone are not enough: their poses are needed, for instance from COLMAP", path.display(), super::list_formats())]
    NoCameras {
        /// The folder that was searched.
        path: PathBuf,
    },
    /// The format asked for is not there.
    #[error("{} holds no {wanted} cameras ({})", path.display(), wanted.files())]
    NotThisFormat {
        /// The folder that was searched.
        path: PathBuf,
        /// The format asked for.
        wanted: FormatKind,
    },
    /// The folder holds several scenes.
    #[error("{} holds several scenes; pass one of them:\n{}", path.display(), lines(scenes))]
    SeveralScenes {
        /// The folder that was searched.
        path: PathBuf,
        /// The scenes in it.
        scenes: Vec<PathBuf>,
    },
    /// Fewer than two photographs could be found for the cameras.
    #[error("{}: {found} of its {stated} photographs could be read below {}, at least 2 are needed; {missing}", cameras.display(), root.display())]
    TooFewImages {
        /// The camera file.
        cameras: PathBuf,
        /// The folder searched for photographs.
        root: PathBuf,
        /// Photographs found.
        found: usize,
        /// Frames in the camera file.
        stated: usize,
        /// The first missing names and why.
        missing: String,
    },
    /// The intrinsics are for an image of another shape.
    #[error("{}: the camera of {frame} is for an image of {}x{} pixels, but {} has {}x{}, which is no scaled copy of it; crop the image or correct the camera file", cameras.display(), stated.0, stated.1, image.display(), actual.0, actual.1)]
    SizeMismatch {
        /// The camera file.
        cameras: PathBuf,
        /// The frame, as the camera file names it.
        frame: String,
        /// The photograph.
        image: PathBuf,
        /// Width and height that the intrinsics refer to.
        stated: (usize, usize),
        /// Width and height of the photograph.
        actual: (usize, usize),
    },
    /// A view was asked for that the scene does not have.
    #[error("no photograph of {} is called {wanted:?}; it has {available}", root.display())]
    NoSuchView {
        /// The scene folder.
        root: PathBuf,
        /// What was asked for.
        wanted: String,
        /// Some of the names there are.
        available: String,
    },
    /// A view was asked for by a name that several photographs carry.
    #[error("{wanted:?} may be any of {} in {}; give the full name", candidates.join(", "), root.display())]
    AmbiguousView {
        /// The scene folder.
        root: PathBuf,
        /// What was asked for.
        wanted: String,
        /// The names that match.
        candidates: Vec<String>,
    },
    /// A photograph could not be read.
    #[error(transparent)]
    Image(#[from] ImageError),
}

fn lines(paths: &[PathBuf]) -> String {
    paths.iter().map(|path| format!("  {}", path.display())).collect::<Vec<_>>().join("\n")
}

/// What a parser of bytes found wrong; it does not know which file it reads.
#[derive(Debug)]
pub(crate) enum Fault {
    /// A sentence without a subject, to follow the file's name.
    Text(String),
    /// A bad pose.
    Pose { frame: String, source: NotRigid },
}

impl Fault {
    pub(crate) fn text(reason: impl Into<String>) -> Self {
        Self::Text(reason.into())
    }

    pub(crate) fn in_file(self, path: &Path) -> SceneError {
        let path = path.to_owned();
        match self {
            Self::Text(reason) => SceneError::Malformed { path, reason },
            Self::Pose { frame, source } => SceneError::Pose { path, frame, source },
        }
    }
}

/// The bytes of a camera file.
pub(crate) fn read_bytes(path: &Path) -> Result<Vec<u8>, SceneError> {
    std::fs::read(path).map_err(|source| SceneError::Read { path: path.to_owned(), source })
}
