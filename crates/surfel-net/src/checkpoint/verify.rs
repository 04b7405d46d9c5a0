//! Is a weights file what it says it is?
//!
//! Invariant: every fault is found in one go, each a sentence.

use super::CheckpointError;
use super::header::Header;
use super::load::check;
use super::tree::parameters;
use crate::model::SurfelNet;
use burn::tensor::Device;
use safetensors::SafeTensors;
use std::collections::BTreeSet;
use std::path::Path;
use surfel_features::WeightsError;
use surfel_features::weights::{TensorFile, read_file};

/// The outcome of looking at every value.
#[derive(Clone, Debug, PartialEq)]
pub struct Verification {
    /// What is wrong; empty for a good file.
    pub faults: Vec<String>,
    /// Tensors of the network its configuration describes.
    pub num_tensors: usize,
    /// Values in them.
    pub num_parameters: usize,
    /// Whether the file states a checksum.
    pub has_checksum: bool,
}

/// Compares a file with its own configuration and checksum, and looks for values that are not finite.
///
/// # Errors
/// [`CheckpointError`] when there is nothing to compare: unreadable, no safetensors file, or no configuration.
pub fn verify(path: &Path) -> Result<Verification, CheckpointError> {
    let (file, bytes) = (path.display().to_string(), read_file(path)?);
    let header = Header::of(&file, &bytes)?;
    let expected = parameters(&SurfelNet::new(header.net_config(&file)?, &Device::flex())?);
    let tensors = TensorFile::parse(&file, &bytes)?;
    let mut faults: Vec<String> = check(&file, &bytes).err().iter().map(WeightsError::to_string).collect();
    for parameter in &expected {
        faults.extend(tensors.values(&parameter.name, &parameter.shape).err().map(|error| error.to_string()));
    }
    let known: BTreeSet<&str> = expected.iter().map(|parameter| parameter.name.as_str()).collect();
    let read = SafeTensors::deserialize(&bytes)
        .map_err(|error| WeightsError::Malformed { file: file.clone(), reason: error.to_string() })?;
    let strangers: BTreeSet<&str> = read.names().into_iter().filter(|name| !known.contains(name)).collect();
    faults.extend(strangers.iter().map(|name| format!("{file} holds {name}, which its network does not have")));
    Ok(Verification {
        faults,
        num_tensors: expected.len(),
        num_parameters: expected.iter().map(|parameter| parameter.values.len()).sum(),
        has_checksum: header.checksum.is_some(),
    })
}
