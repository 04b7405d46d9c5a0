//! Cameras that look a little elsewhere than they are said to, turned until matches meet their epipolar lines.
//!
//! Poses of trackers (phones, headsets, odometry) miss by a pixel or two, and matching looks along epipolar lines only.
//! A match tells how far it is *across* its line. How far it is *along* the line is its depth, which the poses must
//! tell, so turns that move matches along their lines are shunned: for two views there remains the turn about the line
//! between the cameras, by as much for the one as for the other. The invariants: where the cameras stand, their
//! intrinsics and the unit of length play no part, and cameras that matches agree with stay as they are, to the bit.

use crate::Match;
use crate::epipolar::{EpipolarGeometry, inlier_distance, median};
use glam::{DMat3, DQuat, DVec3};
use surfel_core::Camera;

/// Times a motion along epipolar lines counts more than the same motion across them.
const ALONG: f64 = 10.0;
/// Passes of reweighted least squares; the scale of what counts as a miss shrinks from the first to the last.
const NUM_PASSES: i32 = 30;
const SHRINK: f64 = 0.85;
/// Misses at which a match counts half, in inlier distances: at first, and at last.
const SCALE: (f64, f64) = (2.0, 0.25);
/// So many matches must agree in the end.
const MIN_AGREEING: usize = 20;
/// Cameras are turned if matches that agree in the end missed by so many inlier distances in the median, from half a
/// pixel of a 480-pixel view to eight: less is the noise of keypoints, more is no tracker's.
const NOTICEABLE: std::ops::RangeInclusive<f64> = 0.25..=4.0;
/// At most this share of the miss may remain.
const REMAINING: f64 = 2.0 / 3.0;

/// Matches between two of the cameras.
#[derive(Clone, Copy, Debug)]
pub struct PairMatches<'a> {
    /// Index of the camera of [`Match::a`].
    pub a: usize,
    /// Index of the camera of [`Match::b`].
    pub b: usize,
    /// What both see.
    pub matches: &'a [Match],
}

/// Cameras after the turn, and what it brought.
#[derive(Clone, Debug, PartialEq)]
pub struct Turned {
    /// The cameras in their order, each at its place.
    pub cameras: Vec<Camera>,
    /// How far the camera that turned most has turned, degrees.
    pub most_deg: f64,
    /// Median distance from the epipolar lines before and after, pixels, of the matches that agree after it.
    pub median_px: (f64, f64),
    /// Matches that agree with the turned cameras.
    pub num_agreeing: usize,
}

/// Turns `cameras` until matches meet their epipolar lines; `None` where that would not mend a noticeable miss, or too
/// few matches say so.
pub fn turned(cameras: &[Camera], pairs: &[PairMatches]) -> Option<Turned> {
    let turns = turns(cameras, pairs);
    let after: Vec<Camera> = cameras.iter().zip(&turns).map(|(camera, &turn)| turned_by(camera, turn)).collect();
    let (mut misses_before, mut misses_after, mut limit) = (Vec::new(), Vec::new(), 0.0_f64);
    for pair in pairs {
        let geometry = |of: &[Camera]| EpipolarGeometry::of(&of[pair.a], &of[pair.b]);
        let (Some(old), Some(new)) = (geometry(cameras), geometry(&after)) else { continue };
        let near = inlier_distance(&cameras[pair.a], &cameras[pair.b]);
        limit = limit.max(near);
        for m in pair.matches.iter().filter(|m| new.distance(m) < near) {
            misses_before.push(old.distance(m));
            misses_after.push(new.distance(m));
        }
    }
    let num_agreeing = misses_after.len();
    let (before, remaining) = (median(misses_before)?, median(misses_after)?);
    let mends =
        NOTICEABLE.contains(&(before / limit)) && remaining <= REMAINING * before && num_agreeing >= MIN_AGREEING;
    mends.then(|| Turned {
        cameras: after,
        most_deg: turns.iter().map(|turn| turn.length().to_degrees()).fold(0.0, f64::max),
        median_px: (before, remaining),
        num_agreeing,
    })
}

/// The camera turned on the spot by a rotation vector, world frame, radians.
fn turned_by(camera: &Camera, turn: DVec3) -> Camera {
    camera.turned(DMat3::from_quat(DQuat::from_scaled_axis(turn)))
}

/// One rotation vector per camera, world frame, radians: least squares of the misses in pixels, reweighted after Geman
/// and McClure (1985) at a scale that shrinks from pass to pass (Blake and Zisserman 1987). In every pass each camera
/// takes half the step it would need if the others stood still, so two share a turn evenly.
fn turns(cameras: &[Camera], pairs: &[PairMatches]) -> Vec<DVec3> {
    let mut turns = vec![DVec3::ZERO; cameras.len()];
    for pass in 0..NUM_PASSES {
        let mut equations = vec![Equations::default(); cameras.len()];
        for pair in pairs {
            let (a, b) = (turned_by(&cameras[pair.a], turns[pair.a]), turned_by(&cameras[pair.b], turns[pair.b]));
            let Some(baseline) = (b.centre() - a.centre()).try_normalize() else { continue };
            let scale = inlier_distance(&a, &b) * (SCALE.0 * SHRINK.powi(pass)).max(SCALE.1);
            for m in pair.matches.iter().filter(|m| m.a.is_finite() && m.b.is_finite()) {
                let Some(miss) = Miss::of((&a, &b), m, baseline) else { continue };
                let weight = (1.0 + (miss.px / scale).powi(2)).powi(-2);
                equations[pair.a].add(&miss.by_a, miss.px, turns[pair.a], weight);
                equations[pair.b].add(&miss.by_b, miss.px, turns[pair.b], weight);
            }
        }
        turns.iter_mut().zip(&equations).for_each(|(turn, equations)| *turn += 0.5 * equations.step());
    }
    turns
}

/// How far a match is from its epipolar line, and what small turns of either camera do to it.
struct Miss {
    /// Signed distance across the line, pixels.
    px: f64,
    by_a: Motion,
    by_b: Motion,
}

/// Gradients with respect to the rotation vector of one camera, pixels a radian.
struct Motion {
    /// Of the miss.
    across: DVec3,
    /// Of the place along the epipolar line.
    along: DVec3,
}

impl Miss {
    /// The sight lines and the baseline span two planes; the angle between these, times the sine of the angle between
    /// sight line and baseline, is the miss. `None` where a sight line runs along the baseline: the epipole lies on
    /// every line.
    fn of((a, b): (&Camera, &Camera), m: &Match, baseline: DVec3) -> Option<Self> {
        let sight =
            |camera: &Camera, pixel| (camera.camera_from_world.rotation.transpose() * camera.ray(pixel)).normalize();
        let (ray_a, ray_b) = (sight(a, m.a), sight(b, m.b));
        let (normal_a, normal_b) = (baseline.cross(ray_a), baseline.cross(ray_b));
        let (sine_a, sine_b) = (normal_a.length(), normal_b.length());
        if sine_a.min(sine_b) < 1e-6 {
            return None;
        }
        let (normal_a, normal_b) = (normal_a / sine_a, normal_b / sine_b);
        let angle = baseline.dot(normal_a.cross(normal_b)).atan2(normal_a.dot(normal_b));
        let focal = 0.5 * (a.intrinsics.mean_focal() + b.intrinsics.mean_focal());
        let lever = focal * (sine_a * sine_b).sqrt();
        // A turn w moves a ray d by w x d: out of its plane by w . (d x n), within it by w . n, n the plane's normal.
        Some(Self {
            px: lever * angle,
            by_a: Motion { across: ray_a.cross(normal_a) * (-lever / sine_a), along: normal_a * focal },
            by_b: Motion { across: ray_b.cross(normal_b) * (lever / sine_b), along: normal_b * focal },
        })
    }
}

/// Normal equations of the rotation vector of one camera.
#[derive(Clone, Copy, Default)]
struct Equations {
    matrix: DMat3,
    right: DVec3,
}

impl Equations {
    /// Adds a match at the turn so far: its miss shall vanish, its motion along the line stay none.
    fn add(&mut self, motion: &Motion, px: f64, so_far: DVec3, weight: f64) {
        let Motion { across, along } = *motion;
        let square = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
        self.matrix += (square(across) + square(along) * ALONG) * weight;
        self.right -= (across * px + along * (ALONG * along.dot(so_far))) * weight;
    }

    /// The turn that solves them; none where they do not tell, as without any match.
    fn step(&self) -> DVec3 {
        let step = self.matrix.inverse() * self.right;
        if step.is_finite() { step } else { DVec3::ZERO }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_pairs::{looking_at_origin, noiseless, toed_in};
    use crate::{Triangulated, triangulate};
    use glam::DVec2;

    /// Turns a camera about the line to another so that what it sees moves by about `px` across its epipolar lines.
    fn misled(camera: &Camera, other: &Camera, px: f64) -> Camera {
        let line = (camera.centre() - other.centre()).normalize();
        turned_by(camera, line * (px / camera.intrinsics.mean_focal()))
    }

    fn of_pair(a: &Camera, b: &Camera, matches: &[Match]) -> Option<Turned> {
        turned(&[*a, *b], &[PairMatches { a: 0, b: 1, matches }])
    }

    /// Repeatable noise in [-1, 1].
    fn noise(i: usize) -> f64 {
        ((i as f64 + 0.5) * 12.9898).sin() * 43758.5453 % 1.0
    }

    fn noisy(matches: &[Match], px: f64) -> Vec<Match> {
        let moved = |(i, m): (usize, &Match)| Match { b: m.b + DVec2::new(noise(2 * i), noise(2 * i + 1)) * px, ..*m };
        matches.iter().enumerate().map(moved).collect()
    }

    #[test]
    fn the_gradients_of_a_miss_are_its_differences() {
        let (a, b) = toed_in(1.0);
        let baseline = (b.centre() - a.centre()).normalize();
        let miss = |turn_a: DVec3, turn_b: DVec3, m: &Match| {
            Miss::of((&turned_by(&a, turn_a), &turned_by(&b, turn_b)), m, baseline).expect("not the epipole")
        };
        // Steps are those of small misses.
        for m in noisy(&noiseless(&a, &b, 1.0), 0.05).iter().step_by(7) {
            let at = miss(DVec3::ZERO, DVec3::ZERO, m);
            for (k, axis) in DVec3::AXES.into_iter().enumerate() {
                let h = 1e-6;
                let of_a = (miss(axis * h, DVec3::ZERO, m).px - miss(axis * -h, DVec3::ZERO, m).px) / (2.0 * h);
                let of_b = (miss(DVec3::ZERO, axis * h, m).px - miss(DVec3::ZERO, axis * -h, m).px) / (2.0 * h);
                assert!((of_a - at.by_a.across[k]).abs() < 0.3, "{of_a} {}", at.by_a.across[k]);
                assert!((of_b - at.by_b.across[k]).abs() < 0.3, "{of_b} {}", at.by_b.across[k]);
            }
        }
    }

    #[test]
    fn a_misled_camera_comes_back_to_its_lines_at_any_unit_of_length() {
        for unit in [1.0, 1000.0] {
            let (a, b) = toed_in(unit);
            let matches = noiseless(&a, &b, unit);
            let wrong = misled(&b, &a, 2.0);
            let found = of_pair(&a, &wrong, &matches).expect("two pixels are noticeable");
            assert!((found.median_px.0 - 2.0).abs() < 0.2, "{:?}", found.median_px);
            assert!(found.median_px.1 < 0.01, "{:?}", found.median_px);
            assert_eq!(found.num_agreeing, matches.len());
            // Both turn by half.
            assert!((found.most_deg - (1.0f64 / 502.5).to_degrees()).abs() < 0.01, "{}", found.most_deg);
            for (before, after) in [a, wrong].iter().zip(&found.cameras) {
                assert!((before.centre() - after.centre()).length() < 1e-9 * unit, "it stays where it stands");
                assert_eq!(before.intrinsics, after.intrinsics);
            }
        }
    }

    #[test]
    fn depths_stay_what_the_poses_say() {
        let (a, b) = toed_in(1.0);
        let matches = noiseless(&a, &b, 1.0);
        let found = of_pair(&a, &misled(&b, &a, 3.0), &matches).expect("three pixels are noticeable");
        for m in &matches {
            let depth = |pair: &[Camera]| match triangulate(&pair[0], &pair[1], m) {
                Some(Triangulated { point, .. }) => (point - a.centre()).length(),
                None => panic!("the match is in front of both"),
            };
            let (truth, now) = (depth(&[a, b]), depth(&found.cameras));
            assert!((now / truth - 1.0).abs() < 2e-3, "{now} {truth}");
        }
    }

    #[test]
    fn right_cameras_stay_to_the_bit() {
        let (a, b) = toed_in(1.0);
        assert_eq!(of_pair(&a, &b, &noisy(&noiseless(&a, &b, 1.0), 0.8)), None);
        // A miss below half a pixel drowns in the noise of keypoints.
        assert_eq!(of_pair(&a, &misled(&b, &a, 0.3), &noiseless(&a, &b, 1.0)), None);
        assert_eq!(of_pair(&a, &b, &[]), None);
        assert_eq!(of_pair(&a, &a, &noiseless(&a, &b, 1.0)), None, "one place has no lines");
    }

    #[test]
    fn wrong_matches_have_no_say() {
        let (a, b) = toed_in(1.0);
        let mut matches = noisy(&noiseless(&a, &b, 1.0), 0.3);
        for (i, m) in matches.iter_mut().enumerate().filter(|(i, _)| i % 5 < 2) {
            m.b += DVec2::new(noise(i) * 90.0, 8.0 + 80.0 * noise(7 * i).abs());
        }
        let found = of_pair(&a, &misled(&b, &a, -2.0), &matches).expect("three in five agree");
        assert!(found.median_px.1 < 0.25, "{:?}", found.median_px);
        assert!((60..66).contains(&found.num_agreeing), "{}", found.num_agreeing);
    }

    #[test]
    fn three_views_come_back_together() {
        let places = [DVec3::new(-0.7, 0.2, -8.0), DVec3::new(0.6, 0.3, -8.2), DVec3::new(0.1, -0.8, -7.9)];
        let truth = places.map(looking_at_origin);
        let cameras = [truth[0], misled(&truth[1], &truth[0], 2.0), misled(&truth[2], &truth[0], -1.5)];
        let all = [(0, 1), (0, 2), (1, 2)].map(|(a, b)| (a, b, noiseless(&truth[a], &truth[b], 1.0)));
        let pairs = all.each_ref().map(|(a, b, matches)| PairMatches { a: *a, b: *b, matches });
        let found = turned(&cameras, &pairs).expect("noticeable");
        assert!(found.median_px.1 < 0.3 * found.median_px.0, "{:?}", found.median_px);
    }
}
