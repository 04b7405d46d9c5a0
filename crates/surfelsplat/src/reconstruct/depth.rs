//! Depth of every view: matching, and a look at thumbnails where the range is uncertain.
//!
//! Third step of the road, in the working frame. Invariant: estimates and views correspond one to one.

use surfel_core::{Grid, View};
use surfel_stereo::photographs::prepared;
use surfel_stereo::{MatchConfig, probe_ranges};

/// Ranges in which a quick look at thumbnails finds surface, searching a few times farther than `ranges` on
/// either side; `None` where it finds too little to tell.
pub fn probe(
    views: &[View],
    neighbours: &[Vec<usize>],
    ranges: &[(f64, f64)],
    config: &MatchConfig,
) -> Vec<Option<(f64, f64)>> {
    let grays: Vec<Grid<f32>> = views.iter().map(View::gray).collect();
    let wide: Vec<(f64, f64)> = ranges.iter().map(|(near, far)| (near / PROBE_REACH, far * PROBE_REACH)).collect();
    probe_ranges(&prepared(views, &grays, &[], &wide), neighbours, config)
}

/// How many times nearer and farther than the sparse matches the thumbnails are searched.
const PROBE_REACH: f64 = 2.5;
