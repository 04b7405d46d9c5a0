//! Outputs appear whole or not at all: they are written into a hidden folder and renamed into place.
//!
//! The hidden folder lies inside the output folder when that exists (a mount point may differ from its
//! parent's file system), else in its nearest existing ancestor. Invariant: until [`StagedDir::commit`]
//! nothing visible changes, and dropping it leaves nothing behind.

use super::WriteError;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// A set of files that will appear together in one output folder.
#[derive(Debug)]
pub struct StagedDir {
    out: PathBuf,
    staging: PathBuf,
}

impl StagedDir {
    /// Prepares to write into the folder `out`, which need not exist yet, nor its parents.
    ///
    /// # Errors
    /// When `out` or one of its parents is a file, or the place cannot be written to.
    pub fn new(out: &Path) -> Result<Self, WriteError> {
        let home = nearest_folder(out)?;
        let staging = home.join(partial_name(out));
        fs::create_dir(&staging).map_err(WriteError::at(out))?;
        Ok(Self { out: out.to_owned(), staging })
    }

    /// The folder the user asked for; it may not exist before [`Self::commit`].
    pub fn out(&self) -> &Path {
        &self.out
    }

    /// Where the file that will be `out/name` is to be written, for code that needs a path.
    pub fn path(&self, name: impl AsRef<Path>) -> PathBuf {
        self.staging.join(name)
    }

    /// Writes the file that will be `out/name`; folders in `name` are created.
    ///
    /// # Errors
    /// Whatever `content` or the file system reports, with the final path in the message.
    pub fn write(
        &self,
        name: impl AsRef<Path>,
        content: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    ) -> Result<(), WriteError> {
        let path = self.path(&name);
        let written = path.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| {
            let mut file = BufWriter::new(File::create(&path)?);
            content(&mut file)?;
            file.flush()
        });
        written.map_err(WriteError::at(&self.out.join(name)))
    }

    /// Moves everything into place: files of the same names are replaced, all others are kept. The whole
    /// folder appears in one step when `out` did not exist. Returns the final paths, sorted.
    ///
    /// # Errors
    /// When a folder stands where a file should go or the reverse (found before anything is moved), or
    /// the file system refuses.
    pub fn commit(self) -> Result<Vec<PathBuf>, WriteError> {
        let mut names = Vec::new();
        list_files(&self.staging, Path::new(""), &mut names).map_err(WriteError::at(&self.out))?;
        names.sort();
        let targets: Vec<PathBuf> = names.iter().map(|name| self.out.join(name)).collect();
        if !self.out.is_dir() {
            let parent = self.out.parent().unwrap_or(Path::new(""));
            let moved = fs::create_dir_all(parent).and_then(|()| fs::rename(&self.staging, &self.out));
            return moved.map(|()| targets).map_err(WriteError::at(&self.out));
        }
        for target in &targets {
            check_free(target, &self.out)?;
        }
        for (name, target) in names.iter().zip(&targets) {
            let moved =
                target.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::rename(self.path(name), target));
            moved.map_err(WriteError::at(target))?;
        }
        Ok(targets)
    }
}

impl Drop for StagedDir {
    fn drop(&mut self) {
        // After a commit only empty folders are left here, or nothing; there is nobody to tell of a failure.
        let _ = fs::remove_dir_all(&self.staging);
    }
}

/// Writes one file beside its final place and renames it; an existing file is replaced, or kept as it
/// is when anything fails. Missing parent folders are created.
///
/// # Errors
/// Whatever `content` or the file system reports, with `path` in the message.
pub fn write_atomically(
    path: &Path,
    content: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), WriteError> {
    if path.is_dir() {
        return Err(WriteError::FolderInTheWay(path.to_owned()));
    }
    let (Some(name), Some(parent)) = (path.file_name(), path.parent()) else {
        return Err(WriteError::EmptyPath);
    };
    let staged = StagedDir::new(parent_or_here(parent))?;
    staged.write(name, content).map_err(|error| match error {
        WriteError::Io { source, .. } => WriteError::Io { path: path.to_owned(), source },
        other => other,
    })?;
    staged.commit().map(|_| ())
}

fn parent_or_here(parent: &Path) -> &Path {
    if parent.as_os_str().is_empty() { Path::new(".") } else { parent }
}

/// `out` itself or its nearest ancestor that exists, which must be a folder.
fn nearest_folder(out: &Path) -> Result<&Path, WriteError> {
    if out.as_os_str().is_empty() {
        return Err(WriteError::EmptyPath);
    }
    for place in out.ancestors().map(parent_or_here) {
        // Not `exists`: a dangling link occupies the name although it leads nowhere.
        if place.is_dir() {
            return Ok(place);
        } else if place.symlink_metadata().is_ok() {
            return Err(WriteError::NotAFolder(place.to_owned()));
        }
    }
    Ok(Path::new("."))
}

/// A hidden name no other process, and no other call of this one, uses.
fn partial_name(out: &Path) -> String {
    static CALLS: AtomicU64 = AtomicU64::new(0);
    let stem = out.file_name().unwrap_or_default().to_string_lossy();
    format!(".{stem}.partial-{}-{}", std::process::id(), CALLS.fetch_add(1, Ordering::Relaxed))
}

fn list_files(folder: &Path, prefix: &Path, names: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = prefix.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            list_files(&entry.path(), &name, names)?;
        } else {
            names.push(name);
        }
    }
    Ok(())
}

/// Nothing but a file at `target`, nothing but folders between it and `out`.
fn check_free(target: &Path, out: &Path) -> Result<(), WriteError> {
    if target.is_dir() {
        return Err(WriteError::FolderInTheWay(target.to_owned()));
    }
    let between = target.ancestors().skip(1).take_while(|folder| *folder != out);
    between
        .filter(|folder| folder.is_file())
        .map(|file| Err(WriteError::NotAFolder(file.to_owned())))
        .next()
        .unwrap_or(Ok(()))
}
