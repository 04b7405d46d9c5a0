//! What training compares with photographs, depth, normals and masks (paper: `L`; spec 4.3, 7.4).
//!
//! Sits between the rendered maps of `surfel-net` and a training loop. One term per file, each a scalar tensor that
//! gradients flow through; [`view_terms`] adds them up with their weights. Invariant: no term has a unit, so a scene
//! measured in millimetres trains like the same scene in metres.

// burn's nested tensor types exceed the compiler's default depth.
#![recursion_limit = "256"]

mod alignment;
mod depth;
mod depth_normals;
mod error;
mod lpips;
mod mean;
mod normal;
mod opacity;
mod perceptual;
mod photometric;
mod silhouette;
mod ssim;
mod terms;
mod vgg16;

pub use alignment::alignment;
pub use depth::depth;
pub use depth_normals::{DepthNormals, depth_normals};
pub use error::LossError;
pub use lpips::Lpips;
pub use normal::normal;
pub use opacity::opacity;
pub use perceptual::Perceptual;
pub use photometric::photometric;
pub use silhouette::silhouette;
pub use ssim::ssim;
pub use terms::{Recipe, Term, Terms, Truth, view_terms};
