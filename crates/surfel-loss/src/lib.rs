//! What training compares with photographs, depth, normals and masks (paper: `L`; spec 4.3, 7.4).
//!
//! Sits between the maps of `surfel-net` and a training loop. One term per file, each a scalar tensor that gradients
//! flow through. Of rendered maps: [`view_terms`] adds theirs up with their weights. Of the encoder's maps: [`depth`] or
//! [`depth_in_steps`], [`slope`], [`chord`], [`choice`] and [`calibrated_opacity`], which a training loop adds up itself.
//! Invariant: no term has a unit, so a scene measured in millimetres trains like the same scene in metres.

// burn's nested tensor types exceed the compiler's default depth.
#![recursion_limit = "256"]

mod alignment;
mod calibrated_opacity;
mod choice;
mod chord;
mod depth;
mod depth_in_steps;
mod depth_normals;
mod error;
mod lpips;
mod mean;
mod normal;
mod opacity;
mod perceptual;
mod photometric;
mod silhouette;
mod slope;
mod ssim;
mod terms;
mod vgg16;

pub use alignment::alignment;
pub use calibrated_opacity::calibrated_opacity;
pub use choice::choice;
pub use chord::chord;
pub use depth::depth;
pub use depth_in_steps::depth_in_steps;
pub use depth_normals::{DepthNormals, depth_normals};
pub use error::LossError;
pub use lpips::Lpips;
pub use normal::normal;
pub use opacity::opacity;
pub use perceptual::Perceptual;
pub use photometric::photometric;
pub use silhouette::silhouette;
pub use slope::slope;
pub use ssim::ssim;
pub use terms::{Recipe, Term, Terms, Truth, view_terms};
