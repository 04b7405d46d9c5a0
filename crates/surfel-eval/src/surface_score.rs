//! How close a surface, given as points, is to the true one: distances both ways and shares within a threshold.
//!
//! One pair of nearest-neighbour searches serves every figure. Invariant: distances are capped, never discarded, so a
//! missing surface costs the cap and a method cannot score by staying silent.

use crate::chamfer::{Beyond, ChamferScore, FScore, f_score};
use crate::nearest::Nearest;
use serde::Serialize;

/// Scores of one surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SurfaceScore {
    /// Mean capped distances, scene units.
    pub chamfer: ChamferScore,
    /// Shares within the threshold.
    pub f_score: FScore,
    /// Predicted points.
    pub num_predicted: usize,
    /// Points of the true surface.
    pub num_reference: usize,
}

/// Scores predicted against reference points (same frame and unit); distances count `cap` at most, and a point is
/// right when its distance is below `threshold`.
pub fn score_surface(predicted: &[[f32; 3]], reference: &[[f32; 3]], cap: f64, threshold: f64) -> SurfaceScore {
    let to_reference = Nearest::new(reference).distances(predicted, cap);
    let to_predicted = Nearest::new(predicted).distances(reference, cap);
    SurfaceScore {
        chamfer: ChamferScore::from_distances(&to_reference, &to_predicted, cap, Beyond::Cap),
        f_score: f_score(&to_reference, &to_predicted, threshold),
        num_predicted: predicted.len(),
        num_reference: reference.len(),
    }
}

impl SurfaceScore {
    /// The plain mean over scenes of one cap; `None` for an empty slice.
    pub fn mean(scores: &[Self]) -> Option<Self> {
        let first = scores.first()?;
        let mean = |field: fn(&Self) -> f64| scores.iter().map(field).sum::<f64>() / scores.len() as f64;
        Some(Self {
            chamfer: ChamferScore {
                accuracy: mean(|s| s.chamfer.accuracy),
                completeness: mean(|s| s.chamfer.completeness),
                overall: mean(|s| s.chamfer.overall),
                ..first.chamfer
            },
            f_score: FScore {
                precision: mean(|s| s.f_score.precision),
                recall: mean(|s| s.f_score.recall),
                f_score: mean(|s| s.f_score.f_score),
            },
            num_predicted: scores.iter().map(|s| s.num_predicted).sum(),
            num_reference: scores.iter().map(|s| s.num_reference).sum(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square lattice of side 40 mm, 0.25 mm apart, at height `z`.
    fn sheet(z: f32) -> Vec<[f32; 3]> {
        (0..160 * 160).map(|i| [(i % 160) as f32 * 0.25, (i / 160) as f32 * 0.25, z]).collect()
    }

    #[test]
    fn a_sheet_one_millimetre_off_scores_one_millimetre() {
        let score = score_surface(&sheet(1.0), &sheet(0.0), 20.0, 1.5);
        assert!((score.chamfer.accuracy - 1.0).abs() < 1e-6 && (score.chamfer.completeness - 1.0).abs() < 1e-6);
        assert_eq!(score.f_score.f_score, 1.0);
        assert_eq!(score_surface(&sheet(1.0), &sheet(0.0), 20.0, 0.5).f_score.f_score, 0.0);
    }

    #[test]
    fn half_a_sheet_is_accurate_but_incomplete() {
        let half = &sheet(0.0)[..160 * 80];
        let score = score_surface(half, &sheet(0.0), 20.0, 0.1);
        assert_eq!((score.chamfer.accuracy, score.f_score.precision), (0.0, 1.0));
        assert_eq!(score.f_score.recall, 0.5);
        // The missing half is 0.25, 0.5, ... 20 mm away, the last row at the cap itself.
        let expected = 0.5 * 0.25 * 81.0 / 2.0;
        assert!((score.chamfer.completeness - expected).abs() < 1e-5, "{score:?}");
        let mean = SurfaceScore::mean(&[score, score_surface(&sheet(0.0), &sheet(0.0), 20.0, 0.1)]).unwrap();
        assert!((mean.chamfer.completeness - expected / 2.0).abs() < 1e-5 && mean.f_score.recall == 0.75);
    }

    #[test]
    fn searched_distances_equal_those_of_all_pairs() {
        let noise =
            |seed: u32, i: u32| (seed.wrapping_add(i).wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
        let cloud = |seed: u32| -> Vec<[f32; 3]> {
            (0..300u32).map(|i| [0, 1, 2].map(|axis| 30.0 * noise(seed, 3 * i + axis))).collect()
        };
        let (a, b) = (cloud(1), cloud(7_777));
        let mean = |from: &[[f32; 3]], to: &[[f32; 3]]| {
            let nearest = |p: &[f32; 3]| {
                let distance = |q: &[f32; 3]| (0..3).map(|i| f64::from(p[i] - q[i]).powi(2)).sum::<f64>().sqrt();
                to.iter().map(distance).fold(2.0, f64::min)
            };
            from.iter().map(nearest).sum::<f64>() / from.len() as f64
        };
        let score = score_surface(&a, &b, 2.0, 1.0);
        assert!((score.chamfer.accuracy - mean(&a, &b)).abs() < 1e-5);
        assert!((score.chamfer.completeness - mean(&b, &a)).abs() < 1e-5);
    }
}
