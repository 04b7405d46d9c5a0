//! The trained weights that ship with the crate.
//!
//! MODEL_CARD.md says what they are, what they were trained on and how good they are. Invariant: a test reads them.

use crate::checkpoint::CheckpointError;
use crate::model::SurfelNet;
use burn::tensor::Device;

const WEIGHTS: &[u8] = include_bytes!("../weights/small_f16.safetensors");

impl SurfelNet {
    /// The network that ships: preset `small`, trained.
    ///
    /// # Errors
    /// [`CheckpointError`] if the crate was built with a damaged file.
    pub fn shipped(device: &Device) -> Result<Self, CheckpointError> {
        Self::from_bytes("the built-in network", WEIGHTS, device)
    }
}
