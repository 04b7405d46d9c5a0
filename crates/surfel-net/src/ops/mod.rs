//! Numeric kernels on plain slices, and those of them that burn differentiates through.
//!
//! Written over `pulp::Simd`, which picks the vector instructions of the machine at run time without
//! unsafe code. Invariant: results do not depend on the number of threads.

pub mod activation;
pub mod conv;
pub mod epipolar;
pub mod epipolar_attention;
pub mod gather_attention;
pub mod group_norm;
mod join;
mod join_epipolar;
mod join_propagate;
mod join_render;
pub mod kernel;
pub mod plane_sweep;
pub mod propagate;
pub mod render;
mod vector;

pub use activation::Activation;
pub(crate) use activation::{gelu, relu};
pub use group_norm::group_norm;
pub use join::conv::conv2d;
pub use join::{gather_attention, plane_sweep};
pub use join_epipolar::epipolar_attention;
pub use join_propagate::propagate as propagate_planes;
pub(crate) use join_render::render_planes;
