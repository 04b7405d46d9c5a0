//! Scenes with exact ground truth: analytic shapes and textured meshes, ray-cast to images, depth and normals.
//!
//! Everything that estimates a surface is tested, trained and measured against this crate; of the workspace it
//! needs [`surfel_core`] only. Two worlds: analytic scenes ([`SceneOptions`]), and photographs of scanned objects
//! ([`SceneSampler`], feature `assets`). Both give a [`RenderedView`]: a posed picture with the exact depth,
//! normal and object of every pixel. Lengths are scene units, the world's up is +Z, cameras are OpenCV's.
//!
//! ```
//! use surfel_synth::{SceneKind, SceneOptions};
//! let options = SceneOptions { kind: SceneKind::Sphere, width: 64, height: 48, ..SceneOptions::default() };
//! let views = options.render();
//! let (x, y) = (32, 24);
//! assert!(views[0].depth[(x, y)] > 0.0);
//! ```

#[cfg(feature = "assets")]
pub mod assets;
pub mod contact_sheet;
pub mod noise;
pub mod options;
pub mod random;
pub mod render;
pub mod rig;
pub mod root;
pub mod scene;
pub mod sdf;
pub mod shape;
#[cfg(feature = "assets")]
pub mod source;
pub mod texture;
pub mod truth;
pub mod warp;

#[cfg(feature = "assets")]
pub use assets::{AssetError, AssetLibrary, SceneSampler, Split, SynthConfig, SynthScene};
pub use contact_sheet::contact_sheet;
pub use options::{SceneKind, SceneOptions};
pub use random::Random;
pub use render::{RenderOptions, RenderedView};
pub use rig::{OrbitRig, WalkRig, look_at};
pub use scene::{Lighting, Object, Scene};
pub use sdf::Sdf;
pub use shape::{Ray, Shape};
#[cfg(feature = "assets")]
pub use source::{SceneSource, TrueScene};
pub use texture::{Texture, TextureSpace};
pub use truth::SurfaceSamples;
pub use warp::{WarpStatistics, warp_statistics};
