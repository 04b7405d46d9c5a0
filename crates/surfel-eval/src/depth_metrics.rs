//! How close a predicted depth map is to a reference.
//!
//! Rule: every valid *reference* pixel asks the prediction for the depth along its own ray
//! ([`DepthMap::lookup`]), so the two may differ in size. Invariant: shares are of all reference pixels,
//! with a missing prediction a miss; a method cannot score by staying silent.

use crate::depth_map::{DepthMap, is_depth};
use glam::DVec2;
use serde::Serialize;

/// Scores of one depth map, or the mean over several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct DepthScore {
    /// Reference pixels with a depth.
    pub num_reference: usize,
    /// Share of the reference pixels for which there is a prediction.
    pub coverage: f64,
    /// Share of all reference pixels predicted within 0.5 % of the reference depth.
    pub within_half_pct: f64,
    /// Share of all reference pixels predicted within 1 %.
    pub within_1pct: f64,
    /// Share of all reference pixels predicted within 2 %.
    pub within_2pct: f64,
    /// Share of all reference pixels predicted within 5 %.
    pub within_5pct: f64,
    /// Median of |error| over pixels with a prediction, scene units; NaN without any (JSON null).
    pub median_abs_error: f64,
    /// Mean of |error| over pixels with a prediction, scene units.
    pub mean_abs_error: f64,
    /// Median of |error| / reference depth over pixels with a prediction.
    pub median_rel_error: f64,
    /// Mean of |error| / reference depth over pixels with a prediction.
    pub mean_rel_error: f64,
    /// Root mean square error over pixels with a prediction, scene units.
    pub rmse: f64,
    /// Median of the signed error over pixels with a prediction, scene units; above zero the prediction lies behind.
    pub bias: f64,
}

/// Scores a prediction against a reference of the same camera; `None` when the reference has no depth.
pub fn score_depth(predicted: DepthMap, reference: DepthMap) -> Option<DepthScore> {
    let grid = reference.depth;
    let mut num_reference = 0usize;
    let mut abs_errors = Vec::new();
    let mut rel_errors = Vec::new();
    let mut errors = Vec::new();
    for y in 0..grid.height() {
        for x in 0..grid.width() {
            let truth = grid[(x, y)];
            if !is_depth(truth) {
                continue;
            }
            num_reference += 1;
            let pixel = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            if let Some(z) = predicted.lookup(predicted.pixel_from(pixel, reference.intrinsics)) {
                let error = f64::from(z) - f64::from(truth);
                errors.push(error);
                abs_errors.push(error.abs());
                rel_errors.push(error.abs() / f64::from(truth));
            }
        }
    }
    if num_reference == 0 {
        return None;
    }
    let num_predicted = abs_errors.len() as f64;
    let within = |limit: f64| rel_errors.iter().filter(|&&e| e <= limit).count() as f64 / num_reference as f64;
    Some(DepthScore {
        num_reference,
        coverage: num_predicted / num_reference as f64,
        within_half_pct: within(0.005),
        within_1pct: within(0.01),
        within_2pct: within(0.02),
        within_5pct: within(0.05),
        mean_abs_error: abs_errors.iter().sum::<f64>() / num_predicted,
        mean_rel_error: rel_errors.iter().sum::<f64>() / num_predicted,
        rmse: (abs_errors.iter().map(|e| e * e).sum::<f64>() / num_predicted).sqrt(),
        median_abs_error: median(&mut abs_errors),
        median_rel_error: median(&mut rel_errors),
        bias: median(&mut errors),
    })
}

impl DepthScore {
    /// The plain mean over maps (each map counts once, whatever its size); errors are averaged over the
    /// maps that have a prediction. `None` for an empty slice.
    pub fn mean(scores: &[Self]) -> Option<Self> {
        if scores.is_empty() {
            return None;
        }
        let mean = |field: fn(&Self) -> f64| {
            let values: Vec<f64> = scores.iter().map(field).filter(|v| !v.is_nan()).collect();
            values.iter().sum::<f64>() / values.len() as f64
        };
        Some(Self {
            num_reference: scores.iter().map(|s| s.num_reference).sum(),
            coverage: mean(|s| s.coverage),
            within_half_pct: mean(|s| s.within_half_pct),
            within_1pct: mean(|s| s.within_1pct),
            within_2pct: mean(|s| s.within_2pct),
            within_5pct: mean(|s| s.within_5pct),
            median_abs_error: mean(|s| s.median_abs_error),
            mean_abs_error: mean(|s| s.mean_abs_error),
            median_rel_error: mean(|s| s.median_rel_error),
            mean_rel_error: mean(|s| s.mean_rel_error),
            rmse: mean(|s| s.rmse),
            bias: mean(|s| s.bias),
        })
    }
}

/// Median (mean of the two middle values for an even count); NaN for an empty slice. Reorders.
pub fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let (middle, even) = (values.len() / 2, values.len().is_multiple_of(2));
    let (below, &mut upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    if even {
        let lower = below.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        return (lower + upper) / 2.0;
    }
    upper
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_core::{Grid, Intrinsics};

    const K: Intrinsics = Intrinsics { fx: 50.0, fy: 50.0, cx: 16.0, cy: 12.0 };

    #[test]
    fn a_plane_shifted_by_one_millimetre_scores_one_millimetre() {
        let reference = Grid::filled(32, 24, 700.0f32);
        let mut predicted = Grid::filled(32, 24, 701.0f32);
        for x in 0..32 {
            predicted[(x, 0)] = 0.0;
            predicted[(x, 1)] = f32::NAN;
            predicted[(x, 2)] = 900.0;
        }
        let score = score_depth(DepthMap::new(&predicted, &K), DepthMap::new(&reference, &K)).unwrap();
        assert_eq!(score.num_reference, 32 * 24);
        assert!((score.coverage - 22.0 / 24.0).abs() < 1e-12);
        assert!((score.within_1pct - 21.0 / 24.0).abs() < 1e-12);
        assert!((score.within_half_pct - 21.0 / 24.0).abs() < 1e-12);
        assert!((score.median_abs_error - 1.0).abs() < 1e-9 && (score.bias - 1.0).abs() < 1e-9);
        let nearer = score_depth(DepthMap::new(&reference, &K), DepthMap::new(&predicted, &K)).unwrap();
        assert!((nearer.bias + 1.0).abs() < 1e-9, "{nearer:?}");
        assert!((score.mean_abs_error - (21.0 + 200.0) / 22.0).abs() < 1e-9);
        assert!((score.rmse - ((21.0 + 200.0f64 * 200.0) / 22.0).sqrt()).abs() < 1e-9);
    }

    #[test]
    fn half_the_size_is_the_same_prediction() {
        let half = Intrinsics { fx: 25.0, fy: 25.0, cx: 8.0, cy: 6.0 };
        let tilted = |w, h, k: Intrinsics| {
            Grid::from_fn(w, h, |x, _| (10.0 / (1.0 + 0.1 * (x as f64 + 0.5 - k.cx) / k.fx)) as f32)
        };
        let (reference, predicted) = (tilted(32, 24, K), tilted(16, 12, half));
        let score = score_depth(DepthMap::new(&predicted, &half), DepthMap::new(&reference, &K)).unwrap();
        assert_eq!(score.coverage, 1.0);
        // The outermost half pixel has no four neighbours and reads the nearest one.
        assert!(score.median_rel_error < 1e-5 && score.within_half_pct == 1.0, "{score:?}");
    }

    #[test]
    fn nothing_predicted_is_zero_not_perfect_and_no_reference_is_none() {
        let (empty, full) = (Grid::filled(4, 4, 0.0f32), Grid::filled(4, 4, 1.0f32));
        let score = score_depth(DepthMap::new(&empty, &K), DepthMap::new(&full, &K)).unwrap();
        assert_eq!((score.coverage, score.within_5pct), (0.0, 0.0));
        assert!(score.median_abs_error.is_nan());
        assert!(score_depth(DepthMap::new(&full, &K), DepthMap::new(&empty, &K)).is_none());
        let mean = DepthScore::mean(&[score, DepthScore { coverage: 1.0, median_abs_error: 3.0, ..score }]).unwrap();
        assert_eq!((mean.coverage, mean.median_abs_error), (0.5, 3.0));
    }

    #[test]
    fn median_is_the_sorted_middle() {
        for n in 1..12usize {
            let mut values: Vec<f64> = (0..n).map(|i| ((i * 7 + 3) % 11) as f64).collect();
            let mut sorted = values.clone();
            sorted.sort_by(f64::total_cmp);
            let expected = (sorted[(n - 1) / 2] + sorted[n / 2]) / 2.0;
            assert_eq!(median(&mut values), expected);
        }
    }
}
