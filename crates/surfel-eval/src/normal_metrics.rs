//! Angles between predicted and reference normal maps (spec 7.5).
//!
//! Normals are unit vectors in the camera frame. Invariant: valid pixels are those of the reference;
//! angles are averaged over pixels that have both, and `coverage` says how many those are.

use crate::depth_map::{DepthMap, EDGE_RATIO, is_depth, resampled};
use crate::depth_metrics::median;
use glam::DVec3;
use serde::Serialize;
use surfel_core::normals::normals_from_depth;
use surfel_core::{Grid, Intrinsics};

/// Unit normal per pixel, camera frame, `None` where there is none.
pub type NormalMap = Grid<Option<[f32; 3]>>;

/// Scores of one normal map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct NormalScore {
    /// Reference pixels with a normal.
    pub num_reference: usize,
    /// Share of them with a prediction.
    pub coverage: f64,
    /// Mean angle over pixels with both, degrees; NaN without any (JSON null).
    pub mean_angle_deg: f64,
    /// Median angle over pixels with both, degrees.
    pub median_angle_deg: f64,
    /// Share of *all* reference pixels within 11.25 degrees.
    pub within_11_25_deg: f64,
    /// Share of all reference pixels within 30 degrees.
    pub within_30_deg: f64,
    /// Mean of `|n_predicted - n_reference|²`, summed over the three components.
    pub mse_sum: f64,
    /// `mse_sum / 3`: the other reading of the paper's table 3, which does not say which it prints.
    pub mse_mean: f64,
}

impl NormalScore {
    /// The plain mean over maps; angles and errors are averaged over the maps that have a prediction. `None` for an
    /// empty slice.
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
            mean_angle_deg: mean(|s| s.mean_angle_deg),
            median_angle_deg: mean(|s| s.median_angle_deg),
            within_11_25_deg: mean(|s| s.within_11_25_deg),
            within_30_deg: mean(|s| s.within_30_deg),
            mse_sum: mean(|s| s.mse_sum),
            mse_mean: mean(|s| s.mse_mean),
        })
    }
}

/// Unit vectors of a map in which zero (or anything else that is no direction) means none.
pub fn normal_map(normals: &Grid<[f32; 3]>) -> NormalMap {
    normals.map(|&n| {
        let n = glam::Vec3::from(n);
        n.try_normalize().map(|n| n.to_array())
    })
}

/// The map with every pixel outside `mask` left out.
///
/// # Panics
/// If the two differ in size.
pub fn normals_within(normals: &NormalMap, mask: &Grid<bool>) -> NormalMap {
    assert!(normals.same_size(mask), "normal map and mask differ in size");
    let kept = normals.as_slice().iter().zip(mask.as_slice()).map(|(&n, &inside)| n.filter(|_| inside));
    Grid::from_vec(normals.width(), normals.height(), kept.collect())
}

/// Compares two normal maps of the same raster; `None` when the reference has no normal.
///
/// # Panics
/// If the two differ in size.
pub fn score_normals(predicted: &NormalMap, reference: &NormalMap) -> Option<NormalScore> {
    assert!(predicted.same_size(reference), "normal maps differ in size");
    let mut num_reference = 0usize;
    let (mut angles, mut mse) = (Vec::new(), 0.0);
    for (p, r) in predicted.as_slice().iter().zip(reference.as_slice()) {
        let Some(r) = r else { continue };
        num_reference += 1;
        if let Some(p) = p {
            let (p, r) = (DVec3::from(p.map(f64::from)), DVec3::from(r.map(f64::from)));
            // atan2 keeps its precision at small angles, where acos of the dot product loses it.
            angles.push(p.cross(r).length().atan2(p.dot(r)).to_degrees());
            mse += p.distance_squared(r);
        }
    }
    if num_reference == 0 {
        return None;
    }
    let num_both = angles.len() as f64;
    let within = |limit: f64| angles.iter().filter(|&&a| a <= limit).count() as f64 / num_reference as f64;
    Some(NormalScore {
        num_reference,
        coverage: num_both / num_reference as f64,
        within_11_25_deg: within(11.25),
        within_30_deg: within(30.0),
        mean_angle_deg: angles.iter().sum::<f64>() / num_both,
        median_angle_deg: median(&mut angles),
        mse_sum: mse / num_both,
        mse_mean: mse / num_both / 3.0,
    })
}

/// Compares the normals that two depth maps of one camera imply.
///
/// The reference is first brought to the raster of the prediction ([`resampled`]): a normal is a difference of
/// neighbours, so noise and detail only compare at equal pixel size.
pub fn score_depth_normals(predicted: DepthMap, reference: DepthMap) -> Option<NormalScore> {
    let (width, height) = (predicted.depth.width(), predicted.depth.height());
    let reference = resampled(reference, predicted.intrinsics, width, height);
    score_normals(
        &normals_from_depth(predicted.depth, predicted.intrinsics),
        &reference_normals(&reference, predicted.intrinsics),
    )
}

/// Normals of a reference depth map, left out where a pixel and its four neighbours span a depth edge.
pub fn reference_normals(depth: &Grid<f32>, intrinsics: &Intrinsics) -> NormalMap {
    let mut normals = normals_from_depth(depth, intrinsics);
    for y in 1..depth.height().saturating_sub(1) {
        for x in 1..depth.width().saturating_sub(1) {
            let plus = [(x, y), (x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)].map(|at| depth[at]);
            let (low, high) = plus.iter().fold((f32::INFINITY, 0.0f32), |(l, h), &z| (l.min(z), h.max(z)));
            if !is_depth(low) || high > low * EDGE_RATIO {
                normals[(x, y)] = None;
            }
        }
    }
    normals
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turning_every_normal_by_ten_degrees_scores_ten_degrees() {
        let turned = |degrees: f64| {
            let (s, c) = degrees.to_radians().sin_cos();
            Grid::filled(3, 2, Some([s as f32, 0.0, -c as f32]))
        };
        let mut predicted = turned(10.0);
        predicted[(0, 0)] = None;
        let score = score_normals(&predicted, &turned(0.0)).unwrap();
        assert!((score.mean_angle_deg - 10.0).abs() < 1e-4 && (score.median_angle_deg - 10.0).abs() < 1e-4);
        assert!((score.coverage - 5.0 / 6.0).abs() < 1e-12 && (score.within_11_25_deg - 5.0 / 6.0).abs() < 1e-12);
        let chord = 2.0 * 5.0f64.to_radians().sin();
        assert!((score.mse_sum - chord * chord).abs() < 1e-6 && (score.mse_mean * 3.0 - score.mse_sum).abs() < 1e-12);
    }

    #[test]
    fn zero_is_no_normal_and_the_mean_leaves_silent_maps_out() {
        let map = normal_map(&Grid::from_vec(3, 1, vec![[0.0; 3], [0.0, 0.0, -2.0], [f32::NAN, 0.0, 1.0]]));
        assert_eq!(map.as_slice(), [None, Some([0.0, 0.0, -1.0]), None]);
        let only_last = normals_within(&map, &Grid::from_vec(3, 1, vec![true, false, true]));
        assert!(only_last.as_slice().iter().all(Option::is_none));
        let full = score_normals(&map, &map).unwrap();
        let silent = score_normals(&only_last, &map).unwrap();
        let mean = NormalScore::mean(&[full, silent]).unwrap();
        assert_eq!((mean.coverage, mean.mean_angle_deg, mean.num_reference), (0.5, 0.0, 2));
        assert!(NormalScore::mean(&[]).is_none());
    }

    #[test]
    fn depth_normals_of_one_plane_at_two_resolutions_agree_and_edges_are_left_out() {
        let fine_k = Intrinsics { fx: 200.0, fy: 200.0, cx: 64.0, cy: 48.0 };
        let coarse_k = Intrinsics { fx: 100.0, fy: 100.0, cx: 32.0, cy: 24.0 };
        let plane = |w, h, k: Intrinsics, step: bool| {
            Grid::from_fn(w, h, |x, _| {
                let ray = (x as f64 + 0.5 - k.cx) / k.fx;
                let z = 4.0 / (1.0 - 0.7 * ray);
                (if step && x * 2 >= w { z + 1.0 } else { z }) as f32
            })
        };
        let fine = plane(128, 96, fine_k, false);
        let coarse = plane(64, 48, coarse_k, false);
        let score = score_depth_normals(DepthMap::new(&coarse, &coarse_k), DepthMap::new(&fine, &fine_k)).unwrap();
        assert!(score.coverage == 1.0 && score.mean_angle_deg < 0.1, "{score:?}");
        let edge = reference_normals(&plane(64, 48, coarse_k, true), &coarse_k);
        let missing = (1..63).filter(|&x| edge[(x, 20)].is_none()).collect::<Vec<_>>();
        assert_eq!(missing, [31, 32]);
    }
}
