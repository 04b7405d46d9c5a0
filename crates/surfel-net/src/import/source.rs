//! Named tensors of a PyTorch or safetensors file, read one at a time.
//!
//! Which of the two it is is seen in the first bytes, not in the name. Invariant: only one tensor is in memory.

use super::ImportError;
use crate::checkpoint::Header;
use half::{bf16, f16};
use safetensors::Dtype;
use safetensors::tensor::{Metadata, TensorInfo};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;
use surfel_features::WeightsError;
use surfel_torch::{TensorRef, TorchFile, Value};

/// Largest header of a safetensors file, bytes: the safetensors crate's own limit.
const MAX_HEADER_BYTES: u64 = 100_000_000;
/// Dictionaries in which training programs keep the tensors.
const ROOTS: [&str; 3] = ["state_dict", "model", "model_state_dict"];

/// A file with named tensors.
pub struct Source {
    file: String,
    shapes: BTreeMap<String, Vec<usize>>,
    reader: Reader,
}

enum Reader {
    Torch { file: TorchFile<BufReader<File>>, tensors: BTreeMap<String, Arc<TensorRef>> },
    Safetensors { file: File, data_at: u64, tensors: BTreeMap<String, TensorInfo>, header: Header },
}

impl Source {
    /// Opens a file and reads its names and shapes.
    ///
    /// # Errors
    /// [`ImportError`] when it cannot be read or is neither kind of file.
    pub fn open(path: &Path) -> Result<Self, ImportError> {
        let name = path.display().to_string();
        let unreadable = |source| WeightsError::Unreadable { file: name.clone(), source };
        let mut file = File::open(path).map_err(unreadable)?;
        let mut head = Vec::new();
        file.by_ref().take(9).read_to_end(&mut head).map_err(unreadable)?;
        let (reader, shapes) = if head.get(8) == Some(&b'{') && !head.starts_with(b"PK") {
            let (data_at, metadata) = safetensors_header(&mut file, &name)?;
            let tensors: BTreeMap<String, TensorInfo> =
                metadata.tensors().into_iter().map(|(name, info)| (name, info.clone())).collect();
            let shapes = tensors.iter().map(|(name, info)| (name.clone(), info.shape.clone())).collect();
            (Reader::Safetensors { file, data_at, tensors, header: Header::from_metadata(&metadata) }, shapes)
        } else {
            let file = TorchFile::open(path)?;
            let tensors = state_dict(file.root());
            let shapes = tensors.iter().map(|(name, tensor)| (name.clone(), tensor.shape().to_vec())).collect();
            (Reader::Torch { file, tensors }, shapes)
        };
        Ok(Self { file: name, shapes, reader })
    }

    /// The file's name, for messages.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Names of the tensors, sorted.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.shapes.keys().map(String::as_str)
    }

    /// The shape of a tensor, if it is there.
    pub fn shape(&self, name: &str) -> Option<&[usize]> {
        self.shapes.get(name).map(Vec::as_slice)
    }

    /// True for safetensors, false for PyTorch.
    pub fn is_safetensors(&self) -> bool {
        matches!(self.reader, Reader::Safetensors { .. })
    }

    /// The kind of file.
    pub fn format(&self) -> &'static str {
        if self.is_safetensors() { "safetensors" } else { "PyTorch archive" }
    }

    /// How values are stored, each type once.
    pub fn types(&self) -> Vec<String> {
        let types: BTreeSet<String> = match &self.reader {
            Reader::Torch { tensors, .. } => tensors.values().map(|tensor| format!("{:?}", tensor.dtype())).collect(),
            Reader::Safetensors { tensors, .. } => tensors.values().map(|info| format!("{:?}", info.dtype)).collect(),
        };
        types.into_iter().collect()
    }

    /// What the file says about itself; nothing for PyTorch.
    pub fn header(&self) -> Header {
        match &self.reader {
            Reader::Torch { .. } => Header::default(),
            Reader::Safetensors { header, .. } => header.clone(),
        }
    }

    /// The values of a tensor, row-major.
    ///
    /// # Errors
    /// [`ImportError`] when it is missing, cut short, not of floats, or not finite.
    pub fn values(&mut self, name: &str) -> Result<Vec<f32>, ImportError> {
        let (file, tensor) = (|| self.file.clone(), || name.to_owned());
        let missing = || WeightsError::Missing { file: file(), tensor: tensor() };
        let values = match &mut self.reader {
            Reader::Torch { file: torch, tensors } => torch.tensor(tensors.get(name).ok_or_else(missing)?)?.to_f32(),
            Reader::Safetensors { file: source, data_at, tensors, .. } => {
                let info = tensors.get(name).ok_or_else(missing)?;
                let unreadable = |source| WeightsError::Unreadable { file: file(), source };
                source.seek(SeekFrom::Start(*data_at + info.data_offsets.0 as u64)).map_err(unreadable)?;
                let mut bytes = vec![0; info.data_offsets.1 - info.data_offsets.0];
                source.read_exact(&mut bytes).map_err(unreadable)?;
                let wrong_type =
                    || WeightsError::WrongType { file: file(), tensor: tensor(), dtype: format!("{:?}", info.dtype) };
                floats(info.dtype, &bytes).ok_or_else(wrong_type)?
            }
        };
        if values.iter().any(|value| !value.is_finite()) {
            return Err(WeightsError::NotFinite { file: file(), tensor: tensor() }.into());
        }
        Ok(values)
    }
}

/// All tensors of the dictionary that holds them.
fn state_dict(root: &Value) -> BTreeMap<String, Arc<TensorRef>> {
    let dict = ROOTS.iter().find_map(|key| root.get(key).filter(|value| value.as_dict().is_some())).unwrap_or(root);
    let named = |(name, value): &(Value, Value)| Some((name.as_str()?.to_owned(), value.as_tensor()?.clone()));
    dict.as_dict().unwrap_or_default().iter().filter_map(named).collect()
}

/// Where the tensors begin, and the header; checked against the length of the file.
fn safetensors_header(file: &mut File, name: &str) -> Result<(u64, Metadata), WeightsError> {
    let malformed = |reason: String| WeightsError::Malformed { file: name.to_owned(), reason };
    let unreadable = |source| WeightsError::Unreadable { file: name.to_owned(), source };
    let total = file.metadata().map_err(unreadable)?.len();
    let mut length = [0; 8];
    file.seek(SeekFrom::Start(0)).and_then(|_| file.read_exact(&mut length)).map_err(unreadable)?;
    let length = u64::from_le_bytes(length);
    if length > MAX_HEADER_BYTES || length + 8 > total {
        return Err(malformed(format!("its header claims {length} bytes")));
    }
    let mut header = vec![0; length as usize];
    file.read_exact(&mut header).map_err(unreadable)?;
    // Deserializing checks that the tensors fill the data without gaps and have the bytes of their shapes.
    let metadata: Metadata = serde_json::from_slice(&header).map_err(|error| malformed(error.to_string()))?;
    if metadata.data_len() as u64 != total - 8 - length {
        return Err(malformed("it has another length than its header states".to_owned()));
    }
    Ok((8 + length, metadata))
}

fn floats(dtype: Dtype, bytes: &[u8]) -> Option<Vec<f32>> {
    Some(match dtype {
        Dtype::F32 => bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
        Dtype::F64 => bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b) as f32).collect(),
        Dtype::F16 => bytes.as_chunks().0.iter().map(|b| f16::from_le_bytes(*b).to_f32()).collect(),
        Dtype::BF16 => bytes.as_chunks().0.iter().map(|b| bf16::from_le_bytes(*b).to_f32()).collect(),
        _ => return None,
    })
}
