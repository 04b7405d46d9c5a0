//! Trained weights of the network as safetensors, named by the Rust modules (spec 2.12, our own format).
//!
//! The header carries the configuration, so a file alone builds its network, and what people need to know of
//! it: licence, training data, how it was trained, a checksum. Invariant: a file written here loads into a
//! network of the same configuration and no other; it is written beside its place and renamed, so a crash
//! leaves the old one; the same weights give the same bytes.

mod header;
mod load;
mod save;
pub(crate) mod tree;
mod verify;

pub use header::{About, Header};
#[cfg(test)]
pub(crate) use load::filled;
pub use load::load;
pub use save::{Precision, save, save_as};
pub use verify::{Verification, verify};

use crate::config::ConfigError;
use surfel_features::WeightsError;

/// Why a weights file does not give a network.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// It cannot be read, is damaged, or does not fit its own configuration.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// It does not say which network it belongs to.
    #[error("{file} does not state the configuration of its network; only weights written by this program do")]
    NoConfig {
        /// The file.
        file: String,
    },
    /// The configuration in its header cannot be used.
    #[error("the header of {file}: {source}")]
    Config {
        /// The file.
        file: String,
        /// What is wrong with it.
        source: ConfigError,
    },
}
