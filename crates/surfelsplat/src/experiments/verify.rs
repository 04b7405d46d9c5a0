//! Does a rendered scene agree with itself? One view warped into another by its exact depth must look like it.
//!
//! Invariant: a scene is at fault when the colours differ by more than the limit, or when so little overlaps that
//! nothing was compared; either way the sentence says by how much.

use super::error::ExperimentError;
use surfel_eval::report::{Cell, Report, Table};
use surfel_synth::{SceneSource, WarpStatistics, warp_statistics};

/// How far two views may disagree.
#[derive(Clone, Copy, Debug)]
pub struct WarpLimits {
    /// Largest median colour difference, sRGB units in \[0, 1\].
    pub median: f32,
    /// Least share of the pixels with depth that the other view sees.
    pub overlap: f64,
    /// Relative depth difference up to which two pixels are taken to show the same surface.
    pub depth_tolerance: f32,
}

impl Default for WarpLimits {
    fn default() -> Self {
        // Over 150 scenes at 160x128 with camera defects the medians lie between 0.006 and 0.034, the overlaps above 0.38.
        Self { median: 0.05, overlap: 0.1, depth_tolerance: 0.015 }
    }
}

/// Warps neighbouring views of every scene into each other; also returns one sentence per scene at fault.
///
/// # Errors
/// When a scene cannot be drawn.
pub fn verify(
    source: &SceneSource,
    seeds: &[u64],
    limits: &WarpLimits,
) -> Result<(Report, Vec<String>), ExperimentError> {
    let columns = ["scene", "views", "compared", "mean", "median", "90 %", "gain"];
    let mut table = Table::new("Colour difference after warping by the exact depth", columns);
    let mut faults = Vec::new();
    for &seed in seeds {
        let (name, views) = (source.name(seed), source.views(seed)?);
        for (a, b) in neighbours(views.len()) {
            let statistics = warp_statistics(&views[a], &views[b], limits.depth_tolerance);
            table.push(row(&name, (a, b), &statistics));
            faults.extend(fault(&name, (a, b), &statistics, limits));
        }
    }
    let report = Report {
        title: "Rendered views against each other".to_owned(),
        notes: vec![format!(
            "Every pixel looks up its colour in the neighbouring view through its exact depth; differences are sRGB \
             units in [0, 1] after one gain per channel. A scene fails above a median of {} or below {:.0} % overlap.",
            limits.median,
            100.0 * limits.overlap
        )],
        tables: vec![table],
        figures: Vec::new(),
    };
    Ok((report, faults))
}

/// Each view with the next, both ways.
fn neighbours(count: usize) -> impl Iterator<Item = (usize, usize)> {
    (1..count).flat_map(|i| [(i - 1, i), (i, i - 1)])
}

fn row(name: &str, (a, b): (usize, usize), s: &WarpStatistics) -> Vec<Cell> {
    vec![
        name.into(),
        format!("{a} in {b}").into(),
        Cell::Share(share(s)),
        Cell::Value(f64::from(s.mean), 4),
        Cell::Value(f64::from(s.median), 4),
        Cell::Value(f64::from(s.p90), 4),
        s.gain.map(|g| format!("{g:.2}")).join(" ").into(),
    ]
}

fn share(s: &WarpStatistics) -> f64 {
    s.num_compared as f64 / s.num_with_depth.max(1) as f64
}

fn fault(name: &str, (a, b): (usize, usize), s: &WarpStatistics, limits: &WarpLimits) -> Option<String> {
    if share(s) < limits.overlap {
        let percent = 100.0 * share(s);
        return Some(format!(
            "{name}: view {b} sees only {percent:.1} % of what view {a} shows, too little to compare"
        ));
    }
    (s.median.is_nan() || s.median > limits.median).then(|| {
        format!(
            "{name}: view {a} warped into view {b} differs by {:.4} (median), more than {}",
            s.median, limits.median
        )
    })
}
