//! How near and how far a scene reaches, from a quick dense match at thumbnail size.
//!
//! Sparse matches sit on texture and often miss the ground in front or the sky line behind; a coarse sweep
//! over a generous range sees them. Runs before [`crate::estimate_depths`]. Invariant: only pixels that two
//! views agree on and that look alike in both can move the range.

use crate::config::MatchConfig;
use crate::estimate::{MatchView, confident_inverse_depths};

/// Thumbnails have at most this many pixels.
const MAX_PIXELS: usize = 16_000;

/// Share of a thumbnail that must be seen with confidence before it may speak.
const MIN_SHARE: f64 = 0.05;

/// Share of the confident pixels left out at either end, as strays.
const STRAY_SHARE: f64 = 0.01;

/// Share of the range by which the confident pixels are widened on both sides.
const MARGIN: f64 = 0.08;

/// Near and far of every view, scene units, as far as they can be told; `views` carry the range to search.
pub fn probe_ranges(views: &[MatchView], neighbours: &[Vec<usize>], config: &MatchConfig) -> Vec<Option<(f64, f64)>> {
    let mut config = config.clone();
    config.max_sweep_pixels = MAX_PIXELS;
    config.refinement.rounds = 1;
    confident_inverse_depths(views, neighbours, &config)
        .into_iter()
        .zip(views)
        .map(|((mut inverse, num_pixels), view)| {
            if (inverse.len() as f64) < MIN_SHARE * num_pixels as f64 {
                return None;
            }
            inverse.sort_by(f32::total_cmp);
            let at = |share: f64| f64::from(inverse[(share * (inverse.len() - 1) as f64) as usize]);
            let (low, high) = (at(STRAY_SHARE), at(1.0 - STRAY_SHARE));
            let margin = MARGIN * (high - low);
            let (low, high) = ((low - margin).max(1.0 / view.far), (high + margin).min(1.0 / view.near));
            (low > 0.0 && high > low).then_some((1.0 / high, 1.0 / low))
        })
        .collect()
}
