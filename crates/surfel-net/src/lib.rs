//! The surfel network of the paper, on burn.
//!
//! Sits between the photographs and the rasterizer. The folders follow the paper's algorithm 1: `features`,
//! `transformer`, `cost_volume`, `unet`, `depth`, `head`, `nyquist`, `aggregate`; `model` strings them
//! together, and `render` shows the surfels to a camera for training. Invariant: the graph knows no unit of
//! length; depth inside it is relative disparity.

// burn's nested tensor types exceed the compiler's default depth.
#![recursion_limit = "256"]

mod aggregate;
pub mod checkpoint;
pub mod config;
mod cost;
pub mod cost_volume;
mod depth;
pub mod device;
pub mod example_scene;
mod features;
mod head;
pub mod import;
pub mod input;
mod layers;
mod memory;
pub mod model;
pub mod nyquist;
pub mod ops;
mod render;
pub mod seed;
mod shipped;
mod transformer;
/// The modules against their PyTorch twins; inside the crate, because modules are private.
#[cfg(test)]
#[path = "../tests/twin/mod.rs"]
mod twin;
mod unet;

/// Where a network runs; callers need no burn of their own.
pub use burn::tensor::Device;
pub use checkpoint::CheckpointError;
pub use config::{ConfigError, NetConfig, Preset};
pub use cost::Cost;
pub use cost_volume::DepthRange;
pub use depth::Choice;
pub use head::SurfelTensors;
pub use input::{InputError, SceneInput};
pub use layers::values;
pub use memory::keep_freed_memory;
pub use model::{EncoderMaps, Prediction, SurfelNet};
pub use render::{RenderedMaps, render};
pub use seed::Seed;
