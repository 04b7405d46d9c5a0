//! How near and how far the scene is from one view, before any dense matching.
//!
//! Depth matching searches between these two planes. The best evidence at hand decides: sparse points of
//! the camera file, else matches that obey the epipolar constraint, else where the views overlap. The
//! invariant: every rule is a ratio or an angle, so scaling the scene scales the bounds and nothing else.

use crate::Match;
use crate::epipolar::{EpipolarGeometry, has_no_baseline, inlier_distance, median, quantile};
use crate::frustum::census;
use crate::triangulate::triangulate;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use surfel_core::Camera;

/// Fewer points than this do not describe a scene.
const MIN_POINTS: usize = 12;
/// Nearest depth worth searching when only frusta are known, in baselines: at a quarter of the baseline no patch
/// looks the same in both views.
const MIN_DEPTH_IN_BASELINES: f64 = 0.25;
/// Disparity at the far bound, pixels, when nothing better is known: below it depth is noise.
const MIN_DISPARITY_PX: f64 = 1.0;

/// What the bounds rest on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BoundsSource {
    /// Sparse points that came with the cameras.
    Points,
    /// Triangulated matches.
    Matches,
    /// The overlap of the frusta alone.
    Frusta,
}

/// z-depths between which a view's surface lies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Nearest z-depth, scene units.
    pub near: f64,
    /// Farthest z-depth, scene units.
    pub far: f64,
    /// What they rest on.
    pub source: BoundsSource,
    /// Points or matches used; 0 for frusta.
    pub num_points: usize,
    /// The same for people.
    pub sentence: String,
}

/// Another view and the matches towards it, the bounded view first (`Match::a`).
#[derive(Clone, Copy, Debug)]
pub struct Neighbour<'a> {
    /// Camera of the other view.
    pub camera: &'a Camera,
    /// Matches from the bounded view to this one; may be empty.
    pub matches: &'a [Match],
}

/// Why no bounds can be given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BoundsError {
    /// No neighbour stands elsewhere.
    #[error(
        "the depth range cannot be estimated: all cameras stand at the same place; give --near and --far, or views \
         from different places"
    )]
    NoBaseline,
    /// No neighbour sees what the view sees.
    #[error(
        "the depth range cannot be estimated: no other view sees what this view sees; check the poses or give --near \
         and --far"
    )]
    NoOverlap,
}

/// Bounds the depth of a view.
///
/// `points` are world positions known to belong to the scene (possibly none).
///
/// # Errors
/// [`BoundsError`] when there are too few points and matches and the frusta do not help either.
pub fn bounds(view: &Camera, points: &[DVec3], neighbours: &[Neighbour]) -> Result<Bounds, BoundsError> {
    let of_points: Vec<f64> = points
        .iter()
        .filter_map(|&point| view.project(point))
        .filter(|(pixel, _)| view.contains(*pixel))
        .map(|(_, depth)| 1.0 / depth)
        .collect();
    if of_points.len() >= MIN_POINTS {
        return Ok(from_inverse_depths(of_points, BoundsSource::Points));
    }
    let of_matches: Vec<f64> = neighbours.iter().flat_map(|neighbour| inverse_depths(view, neighbour)).collect();
    if of_matches.len() >= MIN_POINTS {
        return Ok(from_inverse_depths(of_matches, BoundsSource::Matches));
    }
    from_frusta(view, neighbours)
}

/// Robust percentiles, widened in disparity (inverse depth): a little for points, generously for matches,
/// which rarely touch the nearest and the farthest surface.
fn from_inverse_depths(inverse_depths: Vec<f64>, source: BoundsSource) -> Bounds {
    let (tail, range_share, level_share, farthest_share) = match source {
        BoundsSource::Points => (0.01, 0.1, 0.03, 0.5),
        _ => (0.02, 0.25, 0.1, 0.33),
    };
    let num_points = inverse_depths.len();
    let of = |share| quantile(inverse_depths.clone(), share).unwrap_or(0.0);
    let (farthest, middle, nearest) = (of(tail), of(0.5), of(1.0 - tail));
    let margin = range_share * (nearest - farthest) + level_share * middle;
    let near = 1.0 / (nearest + margin);
    let far = 1.0 / (farthest - margin).max(farthest_share * farthest);
    let evidence = match source {
        BoundsSource::Points => "sparse points",
        _ => "triangulated matches",
    };
    let sentence = format!("Depth {near:.4} to {far:.4}, from {num_points} {evidence} with a margin.");
    Bounds { near, far, source, num_points, sentence }
}

/// Inverse z-depths in `view` of the matches that lie on their epipolar lines and in front of both cameras. A
/// match without parallax counts as far as one pixel of it can tell.
fn inverse_depths(view: &Camera, neighbour: &Neighbour) -> Vec<f64> {
    let other = neighbour.camera;
    let Some(geometry) = EpipolarGeometry::of(view, other) else { return Vec::new() };
    let limit = inlier_distance(view, other);
    let farthest_known = depth_at_disparity(view, other, MIN_DISPARITY_PX);
    let on_line = neighbour.matches.iter().filter(|m| geometry.distance(m) < limit);
    on_line
        .filter_map(|m| match triangulate(view, other, m) {
            Some(t) if t.depth_a > 0.0 && t.depth_b > 0.0 => Some(1.0 / t.depth_a.min(farthest_known)),
            Some(t) if t.parallax > 1.0 / view.intrinsics.mean_focal() => None,
            _ => Some(1.0 / farthest_known),
        })
        .collect()
}

/// z-depth at which the baseline of two cameras spans so many pixels.
fn depth_at_disparity(view: &Camera, other: &Camera, disparity_px: f64) -> f64 {
    view.intrinsics.mean_focal() * (view.centre() - other.centre()).length() / disparity_px
}

/// The depths at which half of the shared pixels of the view are still seen by a neighbour (for a rectified pair:
/// where the disparity reaches half the image width), and no farther than a disparity of one pixel.
fn from_frusta(view: &Camera, neighbours: &[Neighbour]) -> Result<Bounds, BoundsError> {
    let elsewhere: Vec<&Camera> =
        neighbours.iter().map(|neighbour| neighbour.camera).filter(|other| !has_no_baseline(view, other)).collect();
    if elsewhere.is_empty() {
        return Err(BoundsError::NoBaseline);
    }
    let ranges = elsewhere.into_iter().filter_map(|other| {
        let seen: Vec<(f64, f64)> = census(view, other).into_iter().flatten().collect();
        let nearest = median(seen.iter().map(|range| range.0).collect())?;
        let farthest = median(seen.iter().map(|range| range.1).collect())?;
        let baseline = (view.centre() - other.centre()).length();
        let near = nearest.max(MIN_DEPTH_IN_BASELINES * baseline);
        let far = farthest.min(depth_at_disparity(view, other, MIN_DISPARITY_PX));
        (near < far).then_some((near, far))
    });
    let (near, far) =
        ranges.reduce(|all, range| (all.0.min(range.0), all.1.max(range.1))).ok_or(BoundsError::NoOverlap)?;
    let sentence = format!(
        "Depth {near:.4} to {far:.4}, a guess from where the views overlap: there are too few matches to measure it."
    );
    Ok(Bounds { near, far, source: BoundsSource::Frusta, num_points: 0, sentence })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_pairs::{looking_at_origin, noiseless, scene_points, toed_in};
    use proptest::prelude::*;

    fn of(unit: f64, points: &[DVec3], matches: &[Match]) -> Bounds {
        let (a, b) = toed_in(unit);
        bounds(&a, points, &[Neighbour { camera: &b, matches }]).expect("the views overlap")
    }

    #[test]
    fn the_best_evidence_is_used_and_holds_the_scene() {
        let (a, b) = toed_in(1.0);
        let depths: Vec<f64> = scene_points(1.0).iter().filter_map(|&p| a.project(p)).map(|(_, z)| z).collect();
        let (nearest, farthest) = depths.iter().fold((f64::MAX, 0.0f64), |(lo, hi), &z| (lo.min(z), hi.max(z)));
        let matches = noiseless(&a, &b, 1.0);
        let from_points = of(1.0, &scene_points(1.0), &matches);
        let from_matches = of(1.0, &[], &matches);
        let from_frusta = of(1.0, &[], &[]);
        assert_eq!(from_points.source, BoundsSource::Points);
        assert_eq!(from_matches.source, BoundsSource::Matches);
        assert_eq!(from_frusta.source, BoundsSource::Frusta);
        for found in [&from_points, &from_matches, &from_frusta] {
            assert!(found.near < nearest && found.far > farthest, "{found:?} does not hold {nearest} to {farthest}");
        }
        let ratio = |bounds: &Bounds| bounds.far / bounds.near;
        assert!(ratio(&from_points) < ratio(&from_matches), "matches deserve the wider margin");
        assert!(ratio(&from_matches) < ratio(&from_frusta), "frusta know least");
        assert!(ratio(&from_points) < 1.5 * farthest / nearest, "points know the scene: {from_points:?}");
    }

    #[test]
    fn a_few_wild_points_and_wrong_matches_change_little() {
        let (a, b) = toed_in(1.0);
        let mut matches = noiseless(&a, &b, 1.0);
        let clean = of(1.0, &[], &matches);
        matches.iter_mut().step_by(10).for_each(|m| m.b.y += 25.0);
        let dirty = of(1.0, &[], &matches);
        assert!((dirty.near / clean.near - 1.0).abs() < 0.1 && (dirty.far / clean.far - 1.0).abs() < 0.1, "{dirty:?}");
    }

    #[test]
    fn hopeless_views_say_why() {
        let (a, _) = toed_in(1.0);
        let alone = bounds(&a, &[], &[Neighbour { camera: &a, matches: &[] }]);
        assert_eq!(alone, Err(BoundsError::NoBaseline));
        let mut behind = looking_at_origin(DVec3::new(0.0, 0.1, 8.0));
        behind.camera_from_world.translation.z -= 40.0;
        let apart = bounds(&a, &[], &[Neighbour { camera: &behind, matches: &[] }]);
        assert_eq!(apart, Err(BoundsError::NoOverlap));
    }

    proptest! {
        #[test]
        fn bounds_scale_with_the_scene(exponent in -3.0f64..3.0) {
            let unit = 10f64.powf(exponent);
            let matches = |unit| { let (a, b) = toed_in(unit); noiseless(&a, &b, unit) };
            for (one, other) in [
                (of(1.0, &scene_points(1.0), &[]), of(unit, &scene_points(unit), &[])),
                (of(1.0, &[], &matches(1.0)), of(unit, &[], &matches(unit))),
                (of(1.0, &[], &[]), of(unit, &[], &[])),
            ] {
                prop_assert!((other.near / (unit * one.near) - 1.0).abs() < 1e-6);
                prop_assert!((other.far / (unit * one.far) - 1.0).abs() < 1e-6);
            }
        }
    }
}
