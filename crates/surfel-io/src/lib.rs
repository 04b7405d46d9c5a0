//! Files in, files out: posed scenes in every common format, images with their intrinsics, meshes, splats and maps.
//!
//! [`Scene::open`] finds the cameras of a folder and says which it took; [`Frame::load`] reads one
//! photograph, undistorted and at the size asked for, as a [`surfel_core::View`]. Whatever crosses this
//! crate comes out in the project's conventions (OpenCV axes, first pixel centre at 0.5).

pub mod depth;
pub mod npy;
pub mod photo;
pub mod ply;
pub mod scene;
pub mod write;

pub use photo::ImageError;
pub use scene::{FormatKind, Frame, Scene, SceneError, SceneFormat, SparsePoint, list_formats};
