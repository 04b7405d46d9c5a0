//! Posed training data on disk, in the layouts the paper's own sets come in, as one kind of sample.
//!
//! Beside `surfel-synth`, which makes samples instead. `chunks` (RealEstate10K, ACID), `dtu` and `blended_mvs` are
//! readers; each scene of theirs is a [`SceneViews`], from which `choice` picks views, `fit` brings them to one size
//! and `mirror` doubles their number. Invariant: a [`TrainingView`] is consistent, whatever was done to it: image,
//! camera, depth, normals and mask have one size and mean the same pixels, in the project's conventions.

pub mod blended_mvs;
pub mod choice;
pub mod chunks;
pub mod dtu;
mod error;
pub mod fit;
mod map_resample;
pub mod mirror;
pub mod pairs;
mod sample;
pub mod split;
mod view_files;
pub mod view_index;

pub use error::DataError;
pub use sample::{SceneViews, TrainingScene, TrainingView, load};
