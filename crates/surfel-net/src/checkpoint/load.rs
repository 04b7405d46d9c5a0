//! A file to a network.

use super::CheckpointError;
use super::header::{Header, checksum};
use super::tree::replace_under;
use crate::model::SurfelNet;
use burn::module::Module;
use burn::tensor::Device;
use std::path::Path;
use surfel_features::WeightsError;
use surfel_features::weights::{TensorFile, read_file};

/// The network with all weights replaced by those of a file (f16 or f32).
///
/// # Errors
/// [`WeightsError`] when the file cannot be read, is damaged, or belongs to another configuration.
pub fn load(net: SurfelNet, path: &Path) -> Result<SurfelNet, WeightsError> {
    load_bytes(net, &path.display().to_string(), &read_file(path)?)
}

impl SurfelNet {
    /// The network that a weights file describes and holds.
    ///
    /// # Errors
    /// [`CheckpointError`] when the file cannot be read, is damaged, or does not state its configuration.
    pub fn from_file(path: impl AsRef<Path>, device: &Device) -> Result<Self, CheckpointError> {
        let path = path.as_ref();
        Self::from_bytes(&path.display().to_string(), &read_file(path)?, device)
    }

    /// As [`SurfelNet::from_file`], for a file in memory; `file` is its name in messages.
    ///
    /// # Errors
    /// As [`SurfelNet::from_file`].
    pub fn from_bytes(file: &str, bytes: &[u8], device: &Device) -> Result<Self, CheckpointError> {
        let config = Header::of(file, bytes)?.net_config(file)?;
        Ok(load_bytes(Self::new(config, device)?, file, bytes)?)
    }
}

fn load_bytes(net: SurfelNet, file: &str, bytes: &[u8]) -> Result<SurfelNet, WeightsError> {
    let tensors = TensorFile::parse(file, bytes)?;
    check(file, bytes)?;
    filled(net, &tensors, &[])
}

/// A module with all weights replaced by those a file has under the parts of `prefix`.
pub(crate) fn filled<M: Module>(module: M, tensors: &TensorFile, prefix: &[&str]) -> Result<M, WeightsError> {
    let mut fault = None;
    let module = replace_under(module, prefix, |name, shape| match tensors.values(name, shape) {
        Ok(values) => Some(values),
        Err(error) => {
            fault.get_or_insert(error);
            None
        }
    });
    match fault {
        Some(error) => Err(error),
        None => Ok(module),
    }
}

/// Compares the checksum, where one is stated.
pub(super) fn check(file: &str, bytes: &[u8]) -> Result<(), WeightsError> {
    let Some(stated) = Header::of(file, bytes)?.checksum else { return Ok(()) };
    let found = checksum(bytes);
    if stated == found {
        return Ok(());
    }
    let reason = format!("the checksum of its tensors is {found}, its header states {stated}");
    Err(WeightsError::Malformed { file: file.to_owned(), reason })
}
