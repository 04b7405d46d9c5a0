//! The zip around the pickle: opened once, storages read when their tensors are asked for.
//!
//! Layout: `<name>/data.pkl` describes, `<name>/data/<key>` are raw storages, `<name>/byteorder` may say their byte
//! order. Invariant: entries are stored uncompressed (as PyTorch writes them), so nothing unpacks to more than the
//! file's own size, and at most one storage is in memory at a time.

use crate::error::{Fault, TorchError};
use crate::pickle;
use crate::tensor::{Tensor, TensorRef};
use crate::value::Value;
use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use zip::ZipArchive;

/// The description of all tensors may not be larger than this, bytes.
const MAX_PICKLE_BYTES: u64 = 1 << 28;
/// How the old format begins: a pickle of its magic number.
const LEGACY_MAGIC: &[u8] = b"\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.";

/// An open PyTorch file.
pub struct TorchFile<R> {
    archive: ZipArchive<R>,
    path: PathBuf,
    /// The folder in the archive that everything lies in, with its slash.
    folder: String,
    root: Value,
}

impl TorchFile<BufReader<File>> {
    /// Opens a file and reads its description, but no tensor.
    ///
    /// # Errors
    /// [`TorchError`] when it is missing, of another kind, damaged, or names anything but tensors and plain values.
    pub fn open(path: &Path) -> Result<Self, TorchError> {
        let file = File::open(path).map_err(|source| TorchError::Io { path: path.to_owned(), source })?;
        Self::new(BufReader::new(file), path)
    }
}

impl<'a> TorchFile<Cursor<&'a [u8]>> {
    /// A file in memory; `path` is for messages.
    ///
    /// # Errors
    /// As [`TorchFile::open`].
    pub fn from_bytes(bytes: &'a [u8], path: &Path) -> Result<Self, TorchError> {
        Self::new(Cursor::new(bytes), path)
    }
}

impl<R: Read + Seek> TorchFile<R> {
    fn new(mut reader: R, path: &Path) -> Result<Self, TorchError> {
        refuse_other_kinds(&mut reader, path)?;
        let malformed = |reason: String| TorchError::Malformed { path: path.to_owned(), reason };
        let mut archive = ZipArchive::new(reader).map_err(|error| {
            malformed(format!("its zip archive is not complete ({error}); copy or download it again"))
        })?;
        let folder = folder_of(&archive).ok_or_else(|| TorchError::NotTorch {
            path: path.to_owned(),
            reason: "the zip archive holds no data.pkl".to_owned(),
        })?;
        if archive.index_for_name(&format!("{folder}constants.pkl")).is_some() {
            let reason = "it is a TorchScript program; save its state_dict() with torch.save instead".to_owned();
            return Err(TorchError::NotTorch { path: path.to_owned(), reason });
        }
        let order = format!("{folder}byteorder");
        if archive.index_for_name(&order).is_some() {
            let order = entry(&mut archive, &order, 16).map_err(malformed)?;
            if order.trim_ascii() != b"little" {
                return Err(malformed("was written on a big-endian machine; save it again on another".to_owned()));
            }
        }
        let program = entry(&mut archive, &format!("{folder}data.pkl"), MAX_PICKLE_BYTES).map_err(malformed)?;
        let root = pickle::parse(&program).map_err(|fault| fault.in_file(path))?;
        Ok(Self { archive, path: path.to_owned(), folder, root })
    }

    /// What the file holds.
    pub fn root(&self) -> &Value {
        &self.root
    }

    /// The file's path, for messages.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Reads one tensor, in row-major order whatever its strides.
    ///
    /// # Errors
    /// [`TorchError`] when the storage is missing or cut short.
    pub fn tensor(&mut self, tensor: &TensorRef) -> Result<Tensor, TorchError> {
        let storage = &tensor.storage;
        let fault = |reason: String| Fault::text(reason).in_file(&self.path);
        let len = storage.len.checked_mul(storage.dtype.size()).ok_or_else(|| fault(cut_short(&storage.key)))?;
        let name = format!("{}data/{}", self.folder, storage.key);
        let bytes = entry(&mut self.archive, &name, len as u64).map_err(fault)?;
        if bytes.len() != len {
            return Err(fault(cut_short(&storage.key)));
        }
        Ok(tensor.gather(&bytes))
    }
}

fn cut_short(key: &str) -> String {
    format!("storage {key} has fewer bytes than its tensors need; copy or download the file again")
}

/// The folder that holds `data.pkl`.
fn folder_of<R: Read + Seek>(archive: &ZipArchive<R>) -> Option<String> {
    let folder = |name: &str| {
        let folder = name.strip_suffix("data.pkl")?;
        let inner = folder.strip_suffix('/').unwrap_or(folder);
        (!inner.contains('/') && (folder.is_empty() || folder.ends_with('/'))).then(|| folder.to_owned())
    };
    archive.file_names().find_map(|name| folder(&name.ok()?))
}

/// The bytes of one entry, of which there may be at most `limit`.
fn entry<R: Read + Seek>(archive: &mut ZipArchive<R>, name: &str, limit: u64) -> Result<Vec<u8>, String> {
    let damaged = |error: &dyn std::fmt::Display| {
        format!("{name} cannot be read from its archive ({error}); copy or download the file again")
    };
    let mut entry = archive.by_name(name).map_err(|error| damaged(&error))?;
    if entry.compression() != zip::CompressionMethod::Stored {
        return Err(format!("{name} is compressed, which torch.save never does; save the file again with torch.save"));
    }
    let mut bytes = Vec::new();
    // Not `with_capacity`: the stated size may be a lie.
    entry.by_ref().take(limit.saturating_add(1)).read_to_end(&mut bytes).map_err(|error| damaged(&error))?;
    if bytes.len() as u64 > limit {
        return Err(format!("{name} has more than the {limit} bytes that belong there; it is damaged"));
    }
    Ok(bytes)
}

/// Names what people pass by mistake.
fn refuse_other_kinds<R: Read + Seek>(reader: &mut R, path: &Path) -> Result<(), TorchError> {
    let io = |source| TorchError::Io { path: path.to_owned(), source };
    let mut head = Vec::new();
    reader.by_ref().take(32).read_to_end(&mut head).map_err(io)?;
    reader.seek(SeekFrom::Start(0)).map_err(io)?;
    if head.starts_with(b"PK") {
        return Ok(());
    }
    if head.first() == Some(&0x80) && head.get(2..).is_some_and(|rest| rest.starts_with(LEGACY_MAGIC)) {
        return Err(TorchError::Legacy { path: path.to_owned() });
    }
    let reason = match head.as_slice() {
        [] => "it is empty",
        [_, _, _, _, _, _, _, _, b'{', ..] => "it looks like a safetensors file",
        [0x80, 2..=5, ..] => "it is a bare Python pickle; save its tensors with torch.save instead",
        _ => "it does not begin as a zip archive",
    };
    Err(TorchError::NotTorch { path: path.to_owned(), reason: reason.to_owned() })
}
