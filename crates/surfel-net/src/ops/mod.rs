//! Numeric kernels on plain slices, and those of them that burn differentiates through.
//!
//! Written over `pulp::Simd`, which picks the vector instructions of the machine at run time without
//! unsafe code. Invariant: results do not depend on the number of threads.

pub mod activation;
pub mod attention;
#[cfg(any(feature = "cuda", feature = "wgpu"))]
mod card;
pub mod conv;
pub mod count;
pub mod epipolar;
pub mod epipolar_attention;
pub mod gather_attention;
pub mod group_norm;
mod join;
pub mod judge;
pub mod kernel;
pub mod plane_sweep;
pub mod propagate;
pub mod render;
mod vector;

pub use activation::Activation;
pub(crate) use activation::{gelu, relu};
pub(crate) use attention::attention;
pub use count::multiply_adds;
pub use group_norm::group_norm;
pub use join::{conv2d, epipolar_attention, gather_attention, plane_sweep, propagate_planes};
pub(crate) use join::{judged, render_planes};
pub(crate) use kernel::runs_on;
