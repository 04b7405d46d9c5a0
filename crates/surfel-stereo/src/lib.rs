//! Depth by matching: what two or more posed photographs say without any training.
//!
//! Plane sweep over disparity-uniform candidates with photometric and learned-feature costs, semi-global
//! aggregation, left-right check, and a slanted sub-pixel refinement that also gives normals. Needs no
//! network at run time (features are passed in as plain slices), no files, no burn. It is `--depth matching`
//! and the yardstick the learned network must beat.

mod band;
pub mod candidates;
pub mod config;
pub mod consistency;
pub mod cost_volume;
pub mod estimate;
pub mod feature_costs;
pub mod fill;
mod normal_equations;
mod packed;
mod padded;
pub mod photographs;
pub mod plane_fit;
pub mod probe;
pub mod pyramid;
pub mod semi_global;
pub mod slanted;
pub mod twin;
mod vector;
pub mod warp;
mod window_correlation;
pub mod winner;
pub mod zncc;

/// Raised whenever the same photographs are given another depth: what was matched before is not to be mixed with what
/// is matched now.
pub const EDITION: u32 = 2;

pub use config::MatchConfig;
pub use cost_volume::MatchImage;
pub use estimate::{DepthEstimate, MatchView, estimate_depths};
pub use feature_costs::FeatureGrid;
pub use probe::probe_ranges;
