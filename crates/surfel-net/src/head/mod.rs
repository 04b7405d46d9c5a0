//! Features to surfels: the shared attribute head and the adapter that puts its output into the world.
//!
//! Runs twice with the same weights and the same depth: on the initial and on the refined features (spec
//! 2.7; paper: `Phi_attr`). Invariant: depth is never re-predicted.

mod adapter;
mod attributes;
mod plane_frame;
mod surfel_tensors;

pub(crate) use adapter::{Adapter, Base};
pub(crate) use attributes::AttributeHead;
pub(crate) use plane_frame::{frames_from_normals, normals_away};
pub use surfel_tensors::SurfelTensors;
