//! TSDF fusion of depth maps, marching cubes and mesh cleaning (spec 6.2).
//!
//! The last stage of the pipeline: depth maps with cameras and colours go in, one triangle mesh in the scene's
//! frame and unit comes out. [`mesh_from_views`] does it all and says what it chose and removed; the steps
//! ([`mask_unreliable`], [`fuse`], [`Tsdf::extract`], [`filter_components`]) can be called one by one.
//! Invariant: lengths only ever enter relative to the voxel edge, so a scene in other units gives the same mesh
//! in those units, and the result does not depend on the number of threads.

mod allocate;
pub mod brute;
mod cases;
mod components;
mod continuity;
mod error;
mod extract;
mod from_views;
mod lattice;
mod mask;
mod neighbourhood;
mod normals;
mod observer;
pub mod render;
mod tsdf;
mod vertex;
mod view;

pub use components::{ComponentReport, filter_components};
pub use error::MeshError;
pub use from_views::{MeshConfig, MeshReport, mesh_from_views};
pub use mask::{MaskConfig, MaskCounts, facing, mask_unreliable};
pub use normals::normals_to_the_rim;
pub use tsdf::{Tsdf, TsdfConfig, fuse};
pub use view::DepthView;
