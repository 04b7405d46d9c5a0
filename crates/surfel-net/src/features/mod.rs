//! Image features for the network: the CNN of the paper, or a pyramid over the pretrained trunk, and DINOv2's.
//!
//! First stage of algorithm 1. The frozen trunk itself is the crate `surfel-features`. Invariant: feature
//! pixel `i` of a map of stride `s` stands over input pixel `s i`.

pub(crate) mod cnn;
pub mod dino;
pub(crate) mod pyramid;
