//! Which views belong together, how far the scene is, and whether the cameras can be right.
//!
//! Sits between reading (`surfel-io`) and depth matching (`surfel-stereo`), and knows nothing of
//! files. It takes small views (about 480 pixels wide) and answers with sparse matches, depth
//! bounds, a choice of views and verdicts in plain sentences. The invariant: nothing here depends on
//! the unit of length of the scene.

pub mod descriptor;
pub mod keypoints;
pub mod matching;
pub mod pyramid;

pub use matching::{Features, Match, match_features, match_views};
