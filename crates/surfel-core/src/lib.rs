//! The vocabulary of the project: plain data and closed-form geometry that every other crate shares.
//!
//! Sits at the bottom of the arrow: it depends on no other crate of the workspace, opens no file and
//! starts no thread. Conventions (axes, pixel centres, quaternion order, units) are in
//! `CONVENTIONS.md`; each has a test in `tests/conventions.rs`.

pub mod camera;
pub mod grid;
pub mod lens;
pub mod mesh;
pub mod normals;
pub mod nyquist;
pub mod rigid;
pub mod sh;
pub mod similarity;
pub mod surfels;
pub mod view;

pub use camera::{Camera, Intrinsics};
pub use grid::Grid;
pub use lens::Lens;
pub use mesh::TriMesh;
pub use rigid::Rigid;
pub use similarity::Similarity;
pub use surfels::Surfels;
pub use view::View;
