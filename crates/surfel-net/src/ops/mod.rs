//! Numeric kernels on plain slices.
//!
//! Written over `pulp::Simd`, which picks the vector instructions of the machine at run time without
//! unsafe code. Invariant: results do not depend on the number of threads.

pub(crate) mod depthwise;
pub(crate) mod pointwise;
