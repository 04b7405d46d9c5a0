//! Why weights cannot be imported.

use surfel_features::WeightsError;
use surfel_torch::TorchError;

/// Why weights cannot be imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The source is a PyTorch file that cannot be read.
    #[error(transparent)]
    Torch(#[from] TorchError),
    /// The source is a safetensors file that cannot be read, or the network could not be built.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// None of the names that are known.
    #[error(
        "{file} holds none of the networks that can be imported: its tensors are called {examples}. Looked for `encoder.depth_predictor.…` (SurfelSplat, MVSplat) and `backbone.…` with `transformer.…` (UniMatch)"
    )]
    Unknown {
        /// The file.
        file: String,
        /// The first names in it.
        examples: String,
    },
    /// A part of the image features or the transformer is not there or has another size.
    #[error(
        "{file} gives {found} of the {needed} tensors of backbone and transformer: {name} {why}; the widths must be those of preset paper, and the file complete"
    )]
    Trunk {
        /// The file.
        file: String,
        /// The first tensor that is wrong.
        name: String,
        /// What is wrong with it.
        why: String,
        /// Tensors that fit.
        found: usize,
        /// Tensors that are needed.
        needed: usize,
    },
}
