//! Numeric kernels on plain slices.
//!
//! Invariant: results do not depend on the number of threads.

pub(crate) mod depthwise;
pub(crate) mod pointwise;
pub(crate) mod simd;
