//! What can go wrong while results are written. Invariant: every message names the path the user asked
//! for, not the temporary one.

use std::io;
use std::path::{Path, PathBuf};

/// Why a result could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The file system, or the writer of the format, refused.
    #[error("cannot write {}: {source}", path.display())]
    Io {
        /// The file or folder the user asked for.
        path: PathBuf,
        /// The refusal.
        source: io::Error,
    },
    /// A folder is wanted where a file stands.
    #[error("cannot write into {}: it is a file, not a folder; choose another output folder or move the file away", .0.display())]
    NotAFolder(PathBuf),
    /// A file is wanted where a folder stands.
    #[error("cannot write {}: a folder of that name is in the way; move it or choose another output", .0.display())]
    FolderInTheWay(PathBuf),
    /// The path names nothing.
    #[error("the output path is empty; name a folder or file to write to")]
    EmptyPath,
}

impl WriteError {
    /// For `map_err`: names `path` in the message of an [`io::Error`].
    pub(super) fn at(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io { path: path.to_owned(), source }
    }
}

/// An [`io::Error`] for data that the format cannot hold; `reason` is a sentence without a path.
pub(super) fn unfit(reason: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, reason.into())
}
