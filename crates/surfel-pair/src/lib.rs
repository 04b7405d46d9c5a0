//! Which views belong together, how far the scene is, and whether the cameras can be right.
//!
//! Sits between reading (`surfel-io`) and depth matching (`surfel-stereo`), and knows nothing of
//! files. It takes small views (about 480 pixels wide) and answers with sparse matches, depth
//! bounds, a choice of views, verdicts in plain sentences and cameras turned to meet the matches. The
//! invariant: nothing here depends on the unit of length of the scene.

pub mod bounds;
pub mod choose;
pub mod consensus;
pub mod descriptor;
pub mod epipolar;
pub mod epipolar_picture;
pub mod frustum;
pub mod keypoints;
pub mod matching;
pub mod mistake;
pub mod pair_geometry;
pub mod plausible;
pub mod pyramid;
pub mod sanity;
#[cfg(test)]
mod test_pairs;
pub mod triangulate;
pub mod turn;

pub use bounds::{Bounds, BoundsError, BoundsSource, Neighbour, bounds};
pub use choose::{Choice, ChooseError, choose_pair, choose_views, neighbours};
pub use consensus::{Consensus, consensus};
pub use epipolar::EpipolarGeometry;
pub use epipolar_picture::epipolar_picture;
pub use matching::{Features, Match, match_features, match_views};
pub use mistake::{IntrinsicsMistake, Mistake, PoseMistake};
pub use pair_geometry::{PairGeometry, SparsePoint};
pub use sanity::{Status, Verdict, check_pair};
pub use triangulate::{Side, Triangulated, triangulate};
pub use turn::{PairMatches, Turned, turned};
