//! Features to surfels: the shared attribute head and the adapter that puts its output into the world.
//!
//! Runs twice with the same weights and the same depth: on the initial and on the refined features (spec
//! 2.7; paper: `Phi_attr`). Invariant: depth is never re-predicted.

mod adapter;
mod attributes;
mod surfel_tensors;

pub(crate) use adapter::Adapter;
pub(crate) use attributes::AttributeHead;
pub use surfel_tensors::SurfelTensors;
pub(crate) use surfel_tensors::values;
