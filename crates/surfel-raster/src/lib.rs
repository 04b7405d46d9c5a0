//! Differentiable 2D Gaussian surfel rasterizer on plain slices: forward, backward and a slow obvious twin.
//!
//! Sits between whatever makes surfels (a network, an optimiser) and whatever reads maps (losses, TSDF
//! fusion); it knows neither. [`forward`] blends surfels front to back into [`Maps`], [`backward`] turns
//! gradients of the maps into gradients of the surfels, [`surface`] finds the surface that the surfels sample. Geometry per surfel is computed in f64 and
//! handed to the f32 pixel loops relative to the surfel's own pixel, so a scene far from the origin or a
//! large image loses no precision. Invariant: the result depends neither on the number of threads nor,
//! up to rounding and up to ties in depth, on the order of the surfels.

pub mod bounds;
pub mod config;
pub mod derived;
pub mod error;
pub mod maps;
pub mod pixel_camera;
pub mod quaternion;
pub mod ray_splat;
pub mod sh_colour;
pub mod slices;
pub mod twin;

mod backward;
mod blend;
mod blend_backward;
mod exp;
mod forward;
mod geometry_backward;
mod project;
mod splat;
mod surface;
mod tile;
mod twin_backward;
mod twin_surface;

pub use backward::backward;
pub use config::{BoundingBox, RenderConfig};
pub use error::RasterError;
pub use forward::{Tape, forward, render};
pub use maps::{MapGrads, Maps};
pub use ray_splat::{Footprint, Hit, SplatTransform};
pub use slices::{SurfelGrads, SurfelSlices};
pub use surface::{Surface, surface};
