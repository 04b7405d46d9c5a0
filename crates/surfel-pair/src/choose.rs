//! Which two of many photographs to reconstruct from, when nobody names them.
//!
//! Cameras (and sparse points) make a short list; sparse matches between the few views of that list
//! decide. The invariant: views are asked for one by one and only when short-listed, so a thousand
//! photographs cost no more to open than ten.

use crate::epipolar::{EpipolarGeometry, inlier_distance, median};
use crate::pair_geometry::{Capture, PairGeometry, SparsePoint, angle_score};
use crate::triangulate::{Side, side, triangulate};
use crate::{Features, match_features};
use glam::DVec2;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use surfel_core::{Camera, View};

/// Pairs whose photographs are opened and matched.
const MAX_VERIFIED: usize = 5;
/// Short-listed pairs in which one view may take part, so that one bad photograph cannot spoil the list.
const MAX_PAIRS_PER_VIEW: usize = 2;
/// Fewer agreeing matches verify nothing.
const MIN_AGREEING: usize = 20;
/// Cells per image side in which agreeing matches are looked for.
const CELLS_PER_SIDE: f64 = 8.0;

/// The chosen views and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Indices into the cameras, the reference view first.
    pub views: Vec<usize>,
    /// Triangulation angle of the first two views, degrees: measured on matches, else estimated; `None` if unknown.
    pub angle_deg: Option<f64>,
    /// Share in \[0, 1\] of the first view that the second sees too, from the cameras.
    pub overlap: f64,
    /// Matches of the first two views that agree with the cameras; `None` when no photograph could verify them.
    pub num_matches: Option<usize>,
    /// Why, for people; the names of the views are the caller's to add.
    pub sentence: String,
}

/// Why no views can be chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ChooseError {
    /// Fewer cameras than views wanted.
    #[error("{wanted} views are needed, but the scene has {available}; add photographs with cameras")]
    TooFewViews {
        /// Views asked for.
        wanted: usize,
        /// Cameras given.
        available: usize,
    },
    /// All pairs stand at one place or look away from each other.
    #[error("no two of the {0} cameras see the same thing from different places; check the poses")]
    NothingInCommon(usize),
}

/// Chooses the best pair; of two cameras, those two, however bad.
///
/// `points` may be empty; `load` opens the view of a camera index, small (about 480 pixels wide), or answers
/// `None` when it cannot.
///
/// # Errors
/// [`ChooseError`].
pub fn choose_pair(
    cameras: &[Camera],
    points: &[SparsePoint],
    load: impl FnMut(usize) -> Option<View>,
) -> Result<Choice, ChooseError> {
    choose_views(cameras, points, 2, load)
}

/// Chooses the best pair, then the views that complement its reference best, `count` in all (at least 2).
///
/// # Errors
/// [`ChooseError`].
pub fn choose_views(
    cameras: &[Camera],
    points: &[SparsePoint],
    count: usize,
    mut load: impl FnMut(usize) -> Option<View>,
) -> Result<Choice, ChooseError> {
    let count = count.max(2);
    if cameras.len() < count {
        return Err(ChooseError::TooFewViews { wanted: count, available: cameras.len() });
    }
    let capture = Capture::new(cameras, points);
    if cameras.len() == 2 {
        let geometry = capture.pair(0, 1);
        return Ok(Choice {
            views: vec![0, 1],
            angle_deg: geometry.and_then(|pair| pair.angle_deg),
            overlap: geometry.map_or(0.0, |pair| pair.overlap),
            num_matches: None,
            sentence: "The only two views.".into(),
        });
    }
    let candidates = short_list(&capture, cameras);
    let nothing = ChooseError::NothingInCommon(cameras.len());
    let first = candidates.first().ok_or(nothing)?;

    let mut features: BTreeMap<usize, Option<(Features, Camera)>> = BTreeMap::new();
    let mut best: Option<(f64, &Candidate, Verified)> = None;
    for candidate in &candidates {
        let [i, j] = candidate.views;
        for index in [i, j] {
            features.entry(index).or_insert_with(|| load(index).map(|view| (Features::of(&view), view.camera)));
        }
        let (Some(Some(a)), Some(Some(b))) = (features.get(&i), features.get(&j)) else { continue };
        let Some(verified) = verify(a, b) else { continue };
        let worth = angle_score(verified.angle_deg) * verified.coverage;
        if best.as_ref().is_none_or(|(highest, ..)| worth > *highest) {
            best = Some((worth, candidate, verified));
        }
    }

    let (candidate, verified) = match &best {
        Some((_, candidate, verified)) => (*candidate, Some(verified)),
        None => (first, None),
    };
    let views = completed(&capture, cameras, candidate.views, count);
    let angle_deg = verified.map(|v| v.angle_deg).or(candidate.geometry.angle_deg);
    let num_matches = verified.map(|v| v.num_matches);
    let angle = angle_deg.map_or("at an unknown angle".into(), |degrees| format!("{degrees:.1} degrees apart"));
    let overlap = candidate.geometry.overlap;
    let evidence = match num_matches {
        Some(num) => format!("{num} matches agree with the cameras"),
        None => "no photograph could confirm it: check the cameras".into(),
    };
    let sentence = format!(
        "Best of {} views: the scene is seen {angle}, {:.0} % of the views overlap, {evidence}.",
        cameras.len(),
        100.0 * overlap
    );
    Ok(Choice { views, angle_deg, overlap, num_matches, sentence })
}

/// The views that go best with a reference, best first, at most `count`. Views beside an already chosen one add
/// little and are put back.
pub fn neighbours(cameras: &[Camera], points: &[SparsePoint], reference: usize, count: usize) -> Vec<usize> {
    extended(&Capture::new(cameras, points), cameras, reference, Vec::new(), count)
}

struct Candidate {
    views: [usize; 2],
    geometry: PairGeometry,
}

struct Verified {
    num_matches: usize,
    angle_deg: f64,
    /// Share of the cells of an image with an agreeing match, the smaller of the two images.
    coverage: f64,
}

/// The pairs worth opening, best first.
fn short_list(capture: &Capture, cameras: &[Camera]) -> Vec<Candidate> {
    let mut all: Vec<Candidate> = (0..cameras.len())
        .into_par_iter()
        .flat_map_iter(|i| {
            let pairs = (i + 1..cameras.len()).map(move |j| [i, j]);
            pairs.filter_map(|views| Some(Candidate { views, geometry: capture.pair(views[0], views[1])? }))
        })
        .filter(|candidate| candidate.geometry.score() > 0.0)
        .collect();
    all.sort_by(|p, q| q.geometry.score().total_cmp(&p.geometry.score()));
    let is_depth_known = all.iter().any(|candidate| candidate.geometry.angle_deg.is_some());
    if !is_depth_known {
        all = one_per_baseline_octave(all, cameras);
    }
    let mut uses = vec![0; cameras.len()];
    all.retain(|candidate| {
        let is_fresh = candidate.views.iter().all(|&view| uses[view] < MAX_PAIRS_PER_VIEW);
        candidate.views.iter().filter(|_| is_fresh).for_each(|&view| uses[view] += 1);
        is_fresh || !is_depth_known
    });
    all.truncate(MAX_VERIFIED);
    all
}

/// With unknown depth no baseline is known to be right: tries the best pair of every doubling, and lets the
/// matches decide.
fn one_per_baseline_octave(sorted: Vec<Candidate>, cameras: &[Camera]) -> Vec<Candidate> {
    let octave = |views: [usize; 2]| {
        let baseline = (cameras[views[0]].centre() - cameras[views[1]].centre()).length();
        baseline.log2().floor() as i64
    };
    let mut taken = BTreeSet::new();
    sorted.into_iter().filter(|candidate| taken.insert(octave(candidate.views))).collect()
}

/// Matches two views and measures what the cameras could only guess.
fn verify((features_a, a): &(Features, Camera), (features_b, b): &(Features, Camera)) -> Option<Verified> {
    let geometry = EpipolarGeometry::of(a, b)?;
    let limit = inlier_distance(a, b);
    let mut matches = match_features(features_a, features_b);
    matches.retain(|m| geometry.distance(m) < limit && side(a, b, m) != Side::Behind);
    if matches.len() < MIN_AGREEING {
        return None;
    }
    let angles = matches.iter().filter_map(|m| triangulate(a, b, m)).map(|t| t.parallax.to_degrees()).collect();
    let covered = coverage(a, matches.iter().map(|m| m.a)).min(coverage(b, matches.iter().map(|m| m.b)));
    Some(Verified { num_matches: matches.len(), angle_deg: median(angles)?, coverage: covered })
}

fn coverage(camera: &Camera, pixels: impl Iterator<Item = DVec2>) -> f64 {
    let cell = DVec2::new(camera.width as f64, camera.height as f64) / CELLS_PER_SIDE;
    let cells: BTreeSet<(i64, i64)> =
        pixels.map(|p| ((p.x / cell.x).floor() as i64, (p.y / cell.y).floor() as i64)).collect();
    cells.len() as f64 / (CELLS_PER_SIDE * CELLS_PER_SIDE)
}

fn completed(capture: &Capture, cameras: &[Camera], [reference, second]: [usize; 2], count: usize) -> Vec<usize> {
    let mut views = vec![reference];
    views.extend(extended(capture, cameras, reference, vec![second], count - 1));
    views
}

/// Adds to the chosen neighbours of a reference, greedily, until there are `count`.
fn extended(
    capture: &Capture,
    cameras: &[Camera],
    reference: usize,
    mut chosen: Vec<usize>,
    count: usize,
) -> Vec<usize> {
    let from_reference: Vec<f64> = (0..cameras.len())
        .map(|i| if i == reference { 0.0 } else { capture.pair(reference, i).map_or(0.0, |pair| pair.score()) })
        .collect();
    let distance = |i: usize, j: usize| (cameras[i].centre() - cameras[j].centre()).length();
    while chosen.len() < count {
        let worth = |i: usize| {
            let newness = chosen.iter().map(|&c| distance(i, c) / distance(i, reference)).fold(1.0, f64::min);
            from_reference[i] * newness
        };
        let free = (0..cameras.len()).filter(|i| from_reference[*i] > 0.0 && !chosen.contains(i));
        let Some(next) = free.max_by(|&i, &j| worth(i).total_cmp(&worth(j)).then(j.cmp(&i))) else { break };
        chosen.push(next);
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_pairs::looking_at_origin;
    use glam::DVec3;

    /// An arc about the origin with uneven gaps, degrees.
    fn arc(unit: f64, angles: &[f64]) -> Vec<Camera> {
        let at = |degrees: &f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            looking_at_origin(DVec3::new(8.0 * sin, 0.2, -8.0 * cos) * unit)
        };
        angles.iter().map(at).collect()
    }

    const ANGLES: [f64; 6] = [0.0, 1.0, 31.0, 40.0, 75.0, 160.0];

    #[test]
    fn the_pair_in_the_best_range_of_angles_is_chosen_at_any_scale() {
        for unit in [1e-3, 1.0, 1e3] {
            let choice = choose_pair(&arc(unit, &ANGLES), &[], |_| None).expect("there are good pairs");
            assert_eq!(choice.views, [2, 3], "{choice:?}");
            assert!((choice.angle_deg.expect("the axes meet") - 9.0).abs() < 0.5);
            assert_eq!(choice.num_matches, None);
        }
    }

    #[test]
    fn only_short_listed_views_are_opened_and_each_once() {
        let cameras = arc(1.0, &(0..60).map(|i| 2.0 * i as f64).collect::<Vec<_>>());
        let mut opened = Vec::new();
        choose_pair(&cameras, &[], |index| {
            opened.push(index);
            None
        })
        .expect("there are good pairs");
        let distinct: BTreeSet<_> = opened.iter().collect();
        assert_eq!(distinct.len(), opened.len(), "{opened:?}");
        assert!(opened.len() <= 2 * MAX_VERIFIED, "{opened:?}");
    }

    #[test]
    fn covisible_points_overrule_the_optical_axes() {
        let cameras = arc(1.0, &ANGLES);
        let seen = |views: &'static [usize], at: f64| {
            (0..30)
                .map(move |i| SparsePoint { position: DVec3::new(0.02 * i as f64, at, 0.0), seen_by: views.to_vec() })
        };
        let points: Vec<_> = seen(&[0, 1], 0.0).chain(seen(&[3, 4], 0.1)).collect();
        let pair = Capture::new(&cameras, &points).pair(0, 1).expect("a baseline");
        assert_eq!(pair.overlap, 1.0);
        assert!((pair.angle_deg.expect("points") - 1.0).abs() < 0.2);
    }

    #[test]
    fn neighbours_are_spread_instead_of_stacked() {
        let cameras = arc(1.0, &[0.0, 8.0, 8.01, 8.02, -12.0]);
        let chosen = neighbours(&cameras, &[], 0, 2);
        assert!(chosen.contains(&4), "{chosen:?}");
        assert!(!chosen.contains(&0));
    }

    #[test]
    fn hopeless_captures_say_why() {
        let cameras = arc(1.0, &[0.0, 0.0, 0.0]);
        assert_eq!(choose_pair(&cameras, &[], |_| None), Err(ChooseError::NothingInCommon(3)));
        let too_few = choose_pair(&cameras[..1], &[], |_| None);
        assert_eq!(too_few, Err(ChooseError::TooFewViews { wanted: 2, available: 1 }));
        assert_eq!(choose_pair(&cameras[..2], &[], |_| None).expect("the only two").views, [0, 1]);
    }
}
