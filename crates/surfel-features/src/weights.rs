//! Reading named tensors from a safetensors file, with every shape checked before use.
//!
//! Used by each network that ships or loads weights. Invariant: a damaged or foreign file yields a
//! sentence that names the file and the tensor, never a panic and never an allocation beyond the file's size.

use half::f16;
use safetensors::{Dtype, SafeTensors};
use std::path::Path;

/// Largest weight file that is read, bytes: twice the largest network here, DINOv2 L/14 in single precision.
const MAX_FILE_BYTES: u64 = 2 << 30;

/// Why weights could not be loaded.
#[derive(Debug, thiserror::Error)]
pub enum WeightsError {
    /// The file could not be opened or read.
    #[error("the weight file {file} cannot be read: {source}; check the path and the permissions")]
    Unreadable {
        /// The file.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is larger than any network of this program.
    #[error(
        "the weight file {file} has {bytes} bytes, more than the {MAX_FILE_BYTES} this program accepts; it is probably another kind of file"
    )]
    TooLarge {
        /// The file.
        file: String,
        /// Its size.
        bytes: u64,
    },
    /// Not a safetensors file, or cut off.
    #[error("{file} is not a complete safetensors file ({reason}); copy or download it again")]
    Malformed {
        /// The file.
        file: String,
        /// What the parser said.
        reason: String,
    },
    /// A tensor of the network is not in the file.
    #[error("{file} has no tensor named {tensor}; it belongs to another network")]
    Missing {
        /// The file.
        file: String,
        /// The tensor that was looked for.
        tensor: String,
    },
    /// A tensor has another shape than the network.
    #[error(
        "tensor {tensor} in {file} has shape {found:?} where the network needs {expected:?}; it belongs to another network"
    )]
    WrongShape {
        /// The file.
        file: String,
        /// The tensor.
        tensor: String,
        /// Shape in the file.
        found: Vec<usize>,
        /// Shape of the network.
        expected: Vec<usize>,
    },
    /// A tensor is stored in a type other than f16 or f32.
    #[error("tensor {tensor} in {file} is stored as {dtype}; only F16 and F32 are supported, convert the file")]
    WrongType {
        /// The file.
        file: String,
        /// The tensor.
        tensor: String,
        /// Its type in the file.
        dtype: String,
    },
    /// A file could not be written.
    #[error("the weight file {file} cannot be written: {reason}; check the folder and the free space")]
    Unwritable {
        /// The file.
        file: String,
        /// What the system said.
        reason: String,
    },
    /// A file that is whole, but not of use here.
    #[error("{file} cannot be used: {reason}")]
    Unusable {
        /// The file.
        file: String,
        /// Why.
        reason: String,
    },
    /// A value is NaN or infinite.
    #[error("tensor {tensor} in {file} contains a value that is not a finite number; the file is damaged")]
    NotFinite {
        /// The file.
        file: String,
        /// The tensor.
        tensor: String,
    },
}

/// The bytes of a weight file, refused before reading when it is far too large.
///
/// # Errors
/// [`WeightsError::Unreadable`] and [`WeightsError::TooLarge`].
pub fn read_file(path: &Path) -> Result<Vec<u8>, WeightsError> {
    let file = path.display().to_string();
    let unreadable = |source| WeightsError::Unreadable { file: file.clone(), source };
    let bytes = std::fs::metadata(path).map_err(unreadable)?.len();
    if bytes > MAX_FILE_BYTES {
        return Err(WeightsError::TooLarge { file, bytes });
    }
    std::fs::read(path).map_err(unreadable)
}

/// The tensors of one safetensors buffer.
pub struct TensorFile<'a> {
    file: String,
    tensors: SafeTensors<'a>,
}

impl<'a> TensorFile<'a> {
    /// Opens a buffer; `file` is the name used in messages.
    ///
    /// # Errors
    /// [`WeightsError::Malformed`].
    pub fn parse(file: impl Into<String>, bytes: &'a [u8]) -> Result<Self, WeightsError> {
        let file = file.into();
        let tensors = SafeTensors::deserialize(bytes)
            .map_err(|error| WeightsError::Malformed { file: file.clone(), reason: error.to_string() })?;
        Ok(Self { file, tensors })
    }

    /// The values of `tensor` as f32, row-major, after checking its shape.
    ///
    /// # Errors
    /// [`WeightsError`] when it is missing, has another shape or type, or holds a value that is not finite.
    pub fn values(&self, tensor: &str, expected: &[usize]) -> Result<Vec<f32>, WeightsError> {
        let (file, name) = (|| self.file.clone(), || tensor.to_owned());
        let view = self.tensors.tensor(tensor).map_err(|_| WeightsError::Missing { file: file(), tensor: name() })?;
        if view.shape() != expected {
            let (found, expected) = (view.shape().to_vec(), expected.to_vec());
            return Err(WeightsError::WrongShape { file: file(), tensor: name(), found, expected });
        }
        let values: Vec<f32> = match view.dtype() {
            Dtype::F16 => view.data().chunks_exact(2).map(|b| f16::from_le_bytes([b[0], b[1]]).to_f32()).collect(),
            Dtype::F32 => view.data().chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect(),
            other => {
                let dtype = format!("{other:?}");
                return Err(WeightsError::WrongType { file: file(), tensor: name(), dtype });
            }
        };
        if values.iter().any(|v| !v.is_finite()) {
            return Err(WeightsError::NotFinite { file: file(), tensor: name() });
        }
        Ok(values)
    }
}
