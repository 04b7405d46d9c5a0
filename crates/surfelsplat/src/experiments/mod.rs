//! The experiments of the paper, and the scenes they run on: what `surfelsplat eval` and `synth` do beneath the words.
//!
//! Sits beside the road and uses it from outside; scores come from `surfel-eval`, scenes from `surfel-synth` or from a
//! folder. Invariant: every experiment is a function of its settings and seeds, and returns a
//! [`surfel_eval::report::Report`] without printing or writing it.

pub mod ablation;
pub mod dtu;
pub mod dtu_report;
pub mod efficiency;
mod error;
pub mod export;
pub mod method;
pub mod nvs;
pub mod nyquist;
pub mod predicted;
pub mod synth;
pub mod synth_report;
pub mod verify;

pub use error::ExperimentError;
pub use method::Method;
