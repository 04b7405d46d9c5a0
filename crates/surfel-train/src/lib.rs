//! Training of the surfel network: samples, losses, optimiser, checkpoints.
//!
//! Sits beside the road: `surfel-synth` renders posed scenes with exact truth, `surfel-data` reads photographs of which
//! less is known, `surfel-stereo` matches them as the road would, and the network learns to do better. Invariant: a run is its configuration and its seed; one
//! that was stopped and resumed is the same run.

// burn's nested tensor types exceed the compiler's default depth.
#![recursion_limit = "256"]

pub mod adam;
pub mod augment;
pub mod cache;
mod choice;
pub mod config;
pub mod error;
mod facing;
pub mod loss;
mod loss_weights;
mod metrics;
mod new_views;
pub mod parameters;
mod pictures;
mod rendered;
pub mod sample;
mod sample_file;
pub mod schedule;
pub mod source;
pub mod state;
pub mod trainer;
pub mod truth;
mod truth_tensors;
pub mod validate;

pub use config::TrainConfig;
pub use error::TrainError;
pub use loss_weights::RenderedWeights;
pub use sample::Sample;
pub use trainer::{Places, Trainer, Watcher};
pub use truth::ViewTruth;
