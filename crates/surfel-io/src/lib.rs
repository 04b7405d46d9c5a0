//! Files in, files out: posed scenes in every common format, images with their intrinsics, meshes, splats and maps.

pub mod write;
