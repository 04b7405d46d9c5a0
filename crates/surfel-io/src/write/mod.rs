//! Results out: meshes, splats, maps and the preview picture, the last station of the pipeline.
//!
//! Every format is a function of `&mut impl Write` that returns [`std::io::Result`]; [`StagedDir`] and
//! [`write_atomically`] give it a file and name the path in the error. Invariant: a file appears under
//! its name whole or not at all.

mod caption;
mod colour_map;
mod error;
mod picture;
mod placed_mesh;
mod ply_header;
mod png_file;
mod staged;

pub mod cameras_json;
pub mod confidence_png;
pub mod depth_png;
pub mod glb;
pub mod normal_png;
pub mod obj;
pub mod pfm;
pub mod picture_png;
pub mod ply_mesh;
pub mod ply_surfels;
pub mod preview;
pub mod surfels_from_ply;

pub use error::WriteError;
pub use placed_mesh::PlacedMesh;
pub use staged::{StagedDir, write_atomically};

/// Name and version of the program, as files record it.
pub const GENERATOR: &str = concat!("surfelsplat ", env!("CARGO_PKG_VERSION"));
