//! The networks: pretrained image features and, on burn, the surfel network.
//!
//! Sits between the photographs and the rasterizer. The folders follow the paper's algorithm 1: `features`,
//! `transformer`, `cost_volume`, `unet`, `depth`, `head`, `nyquist`, `aggregate`; `model` strings them
//! together. Matching without learning uses [`FeatureExtractor`] alone, which runs on plain slices.
//! Invariant: no public item of `features` or `weights` names a burn type.

// burn's nested tensor types exceed the compiler's default depth.
#![recursion_limit = "256"]

mod aggregate;
pub mod checkpoint;
pub mod config;
pub mod cost_volume;
mod depth;
pub mod features;
mod head;
pub mod input;
mod layers;
pub mod model;
pub mod nyquist;
pub mod ops;
mod transformer;
mod unet;
pub mod weights;

pub use config::{ConfigError, NetConfig, Preset};
pub use cost_volume::DepthRange;
pub use features::{FeatureExtractor, FeatureMap, Stage};
pub use head::SurfelTensors;
pub use input::{InputError, SceneInput};
pub use model::{Prediction, SurfelNet};
pub use weights::WeightsError;
