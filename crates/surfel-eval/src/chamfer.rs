//! Chamfer distance and F-score between two point sets.
//!
//! The two directions are kept apart: *accuracy* goes from the prediction to the reference, *completeness*
//! from the reference to the prediction. Invariant: what happens to distances beyond the limit is chosen by
//! the caller and named in the score, because it decides whether a missing surface costs anything.

use crate::nearest::Nearest;
use serde::Serialize;

/// What a distance at or beyond the limit counts as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Beyond {
    /// The limit itself: a missing or stray surface costs the limit.
    Cap,
    /// Nothing: left out of the mean, as in the DTU protocol (spec 7.1 e).
    Discard,
}

/// Chamfer distances, scene units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ChamferScore {
    /// Mean distance prediction to reference ("d2s" on DTU).
    pub accuracy: f64,
    /// Mean distance reference to prediction ("s2d" on DTU).
    pub completeness: f64,
    /// Mean of the two.
    pub overall: f64,
    /// Distance at which `beyond` sets in, scene units.
    pub limit: f64,
    /// How distances beyond the limit were counted.
    pub beyond: Beyond,
}

impl ChamferScore {
    /// From the nearest-neighbour distances of both directions.
    pub fn from_distances(to_reference: &[f32], to_predicted: &[f32], limit: f64, beyond: Beyond) -> Self {
        let accuracy = mean_distance(to_reference, limit, beyond);
        let completeness = mean_distance(to_predicted, limit, beyond);
        Self { accuracy, completeness, overall: (accuracy + completeness) / 2.0, limit, beyond }
    }
}

/// Share of points within a threshold of the other set, and their harmonic mean.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FScore {
    /// Share of predicted points closer than the threshold to the reference.
    pub precision: f64,
    /// Share of reference points closer than the threshold to the prediction.
    pub recall: f64,
    /// Harmonic mean of the two; 0 when both are.
    pub f_score: f64,
}

/// Chamfer distance between predicted and reference points (same frame and unit).
pub fn chamfer(predicted: &[[f32; 3]], reference: &[[f32; 3]], limit: f64, beyond: Beyond) -> ChamferScore {
    let to_reference = Nearest::new(reference).distances(predicted, limit);
    let to_predicted = Nearest::new(predicted).distances(reference, limit);
    ChamferScore::from_distances(&to_reference, &to_predicted, limit, beyond)
}

/// Mean of nearest-neighbour distances with those `>= limit` treated as `beyond` says.
///
/// Without any distance to average, `Cap` answers the limit (nothing predicted is everything missed) and
/// `Discard` NaN.
pub fn mean_distance(distances: &[f32], limit: f64, beyond: Beyond) -> f64 {
    let (mut sum, mut count) = (0.0f64, 0usize);
    for &distance in distances {
        let distance = f64::from(distance);
        if distance < limit {
            (sum, count) = (sum + distance, count + 1);
        } else if beyond == Beyond::Cap {
            (sum, count) = (sum + limit, count + 1);
        }
    }
    match (count, beyond) {
        (0, Beyond::Cap) => limit,
        _ => sum / count as f64,
    }
}

/// Precision, recall and F-score from the nearest-neighbour distances of both directions.
pub fn f_score(to_reference: &[f32], to_predicted: &[f32], threshold: f64) -> FScore {
    let share = |distances: &[f32]| {
        let hits = distances.iter().filter(|&&d| f64::from(d) < threshold).count();
        if distances.is_empty() { 0.0 } else { hits as f64 / distances.len() as f64 }
    };
    let (precision, recall) = (share(to_reference), share(to_predicted));
    let sum = precision + recall;
    FScore { precision, recall, f_score: if sum > 0.0 { 2.0 * precision * recall / sum } else { 0.0 } }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sphere(radius: f32, count: usize) -> Vec<[f32; 3]> {
        let spiral = |i: usize| {
            let z = 1.0 - (2.0 * i as f32 + 1.0) / count as f32;
            let (s, c) = (2.399_963_2 * i as f32).sin_cos();
            let r = (1.0 - z * z).sqrt();
            [r * c, r * s, z].map(|v| v * radius)
        };
        (0..count).map(spiral).collect()
    }

    #[test]
    fn concentric_spheres_score_the_difference_of_their_radii() {
        // Same directions on both, so the nearest neighbour is the radial one.
        let score = chamfer(&sphere(10.5, 20_000), &sphere(10.0, 20_000), 20.0, Beyond::Discard);
        assert!((score.accuracy - 0.5).abs() < 1e-3 && (score.completeness - 0.5).abs() < 1e-3, "{score:?}");
        assert!((score.overall - 0.5).abs() < 1e-3);
    }

    #[test]
    fn a_missing_half_costs_the_cap_or_nothing() {
        let reference: Vec<[f32; 3]> = (0..10).map(|i| [i as f32 * 100.0, 0.0, 0.0]).collect();
        let predicted: Vec<[f32; 3]> = reference[..5].iter().map(|p| [p[0], 1.0, 0.0]).collect();
        let capped = chamfer(&predicted, &reference, 20.0, Beyond::Cap);
        assert_eq!((capped.accuracy, capped.completeness), (1.0, (5.0 + 100.0) / 10.0));
        let discarded = chamfer(&predicted, &reference, 20.0, Beyond::Discard);
        assert_eq!((discarded.accuracy, discarded.completeness), (1.0, 1.0));
    }

    #[test]
    fn nothing_predicted_is_everything_missed() {
        let score = chamfer(&[], &[[0.0; 3]], 20.0, Beyond::Cap);
        assert_eq!((score.accuracy, score.completeness, score.overall), (20.0, 20.0, 20.0));
        assert!(chamfer(&[], &[[0.0; 3]], 20.0, Beyond::Discard).overall.is_nan());
    }

    #[test]
    fn f_score_is_the_harmonic_mean() {
        let score = f_score(&[0.1, 0.1, 0.1, 5.0], &[0.1, 5.0], 1.0);
        assert_eq!((score.precision, score.recall), (0.75, 0.5));
        assert!((score.f_score - 0.6).abs() < 1e-12);
        assert_eq!(f_score(&[], &[3.0], 1.0).f_score, 0.0);
    }
}
