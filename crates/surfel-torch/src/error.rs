//! Why a PyTorch file is refused, said to the person who has it.
//!
//! The unpickler knows bytes only and reports a [`Fault`]; `archive` adds the file's name. Invariant: every
//! message names the file.

use std::path::{Path, PathBuf};

/// Why a PyTorch file could not be read, or not be written.
#[derive(Debug, thiserror::Error)]
pub enum TorchError {
    /// The file could not be opened, read or written at all.
    #[error("cannot access {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Written by PyTorch before 1.6, or with `_use_new_zipfile_serialization=False`.
    #[error(
        "{} is in PyTorch's old format, before zip archives; if you trust it, convert it with\n  python -c \"import torch; torch.save(torch.load('{}', map_location='cpu'), 'converted.pth')\"",
        path.display(), path.display()
    )]
    Legacy {
        /// The file.
        path: PathBuf,
    },
    /// Another kind of file.
    #[error("{} is no PyTorch archive: {reason}", path.display())]
    NotTorch {
        /// The file.
        path: PathBuf,
        /// What it is instead, or what is missing.
        reason: String,
    },
    /// The file asks for something that is not a tensor or a plain value.
    #[error(
        "{} wants to load `{global}`, which is neither a tensor nor a plain value, and is refused; if you trust the file, keep its tensors only, for instance with\n  python -c \"import torch; torch.save(torch.load('{}', map_location='cpu', weights_only=False)['state_dict'], 'tensors.pth')\"",
        path.display(), path.display()
    )]
    Forbidden {
        /// The file.
        path: PathBuf,
        /// `module.name`.
        global: String,
    },
    /// Damaged, or beyond what is read.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

/// What is wrong with bytes whose file is not known here.
#[derive(Debug, PartialEq)]
pub(crate) enum Fault {
    /// A sentence without a subject, to follow the file's name.
    Text(String),
    /// A global that is not allowed, `module.name`.
    Forbidden(String),
}

impl Fault {
    pub(crate) fn text(reason: impl Into<String>) -> Self {
        Self::Text(reason.into())
    }

    pub(crate) fn in_file(self, path: &Path) -> TorchError {
        let path = path.to_owned();
        match self {
            Self::Text(reason) => TorchError::Malformed { path, reason },
            Self::Forbidden(global) => TorchError::Forbidden { path, global },
        }
    }
}
