//! The networks: pretrained image features and, on burn, the surfel network.
//!
//! Sits between the photographs and the rasterizer. `features` runs without burn, on plain slices, so
//! that matching needs no learning framework. Invariant: no public item of `features` or `weights`
//! names a burn type.

pub mod features;
pub mod ops;
pub mod weights;

pub use features::{FeatureExtractor, FeatureMap, Stage};
pub use weights::WeightsError;
