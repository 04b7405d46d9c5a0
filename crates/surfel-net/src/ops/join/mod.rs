//! The numeric kernels as functions of tensors: one file per kernel, each an implementation of
//! [`super::kernel::Kernel`] and the function that models call.
//!
//! Invariant: no gradient flows to geometry (poses, candidates, planes that propose, regions, lines).

mod conv;
mod epipolar;
mod gather;
mod judge;
mod propagate;
mod render;
mod sweep;

pub use conv::conv2d;
pub use epipolar::epipolar_attention;
pub use gather::gather_attention;
pub(crate) use judge::judged;
pub use propagate::propagate_planes;
pub(crate) use render::render_planes;
pub use sweep::plane_sweep;
