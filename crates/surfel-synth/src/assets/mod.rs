//! Endless photographs of textured scans with exact depth, normals and masks (feature `assets`).
//!
//! `library` reads a folder of GLB meshes, textures and light maps; `sampler` draws a scene from a seed (`tabletop`,
//! `room` or `street`: `arrange` puts objects together, `building` on its `plot`, of `stone` and by way of `masonry`,
//! builds, `foliage` plants); `stage` is what rays see: `instance`s of meshes, `panel`s, a `backdrop` and `light`;
//! `photograph` and `sensor` take the picture; `surface` is the exact answer. Invariant: depth and normals are those of
//! the triangles, whatever the picture shows.

mod arrange;
mod building;
mod foliage;
mod masonry;
mod openness;
mod plot;
mod room;
mod stone;
mod street;
mod tabletop;
mod vertex_shading;

pub mod backdrop;
pub mod error;
pub mod glb;
pub mod instance;
pub mod library;
pub mod light;
pub mod mesh;
pub mod panel;
pub mod photograph;
pub mod sampler;
pub mod sensor;
pub mod stage;
pub mod surface;
pub mod texels;

pub use error::AssetError;
pub use library::{AssetLibrary, Split};
pub use sampler::{SceneSampler, SynthConfig, SynthScene};
