//! The line on which a pixel of one view must be found in the other, and how far a match misses it.
//!
//! The measure by which matches judge cameras (Hartley and Zisserman 2004, chapter 9): no depth is
//! needed, only the relative pose and the intrinsics. The invariant: distances are pixels of the
//! view they are measured in, and scaling the world changes none of them.

use crate::Match;
use glam::{DMat3, DVec2, DVec3};
use surfel_core::{Camera, Intrinsics};

/// Epipolar geometry of an ordered pair of views: `b^T F a = 0` for matching pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EpipolarGeometry {
    /// Fundamental matrix on continuous homogeneous pixels.
    pub fundamental: DMat3,
}

impl EpipolarGeometry {
    /// From two cameras; `None` when they stand at the same place, where every pixel may match any
    /// depth and no line exists.
    pub fn of(a: &Camera, b: &Camera) -> Option<Self> {
        if has_no_baseline(a, b) {
            return None;
        }
        let b_from_a = b.camera_from_world * a.camera_from_world.inverse();
        let essential = cross_matrix(b_from_a.translation.normalize()) * b_from_a.rotation;
        let fundamental = pixel_inverse(&b.intrinsics).transpose() * essential * pixel_inverse(&a.intrinsics);
        fundamental.is_finite().then_some(Self { fundamental })
    }

    /// Line `(u, v, w)` in view b, `u x + v y + w = 0` with `u^2 + v^2 = 1`, of a pixel of view a;
    /// `None` at the epipole.
    pub fn line_in_b(&self, a: DVec2) -> Option<DVec3> {
        unit_line(self.fundamental * a.extend(1.0))
    }

    /// Line in view a of a pixel of view b.
    pub fn line_in_a(&self, b: DVec2) -> Option<DVec3> {
        unit_line(self.fundamental.transpose() * b.extend(1.0))
    }

    /// The larger of the two distances between a point and the line of its partner, pixels. A pixel on
    /// the epipole lies on every line; one that is not finite is infinitely far.
    pub fn distance(&self, m: &Match) -> f64 {
        if !m.a.is_finite() || !m.b.is_finite() {
            return f64::INFINITY;
        }
        let in_b = self.line_in_b(m.a).map_or(0.0, |line| line.dot(m.b.extend(1.0)).abs());
        let in_a = self.line_in_a(m.b).map_or(0.0, |line| line.dot(m.a.extend(1.0)).abs());
        in_a.max(in_b)
    }
}

/// Largest distance of an inlier, pixels: 1/240 of the longer side (2 px of a 480-pixel view), which
/// lets through poses of a phone's tracker and stops those of another convention.
pub fn inlier_distance(a: &Camera, b: &Camera) -> f64 {
    let longest = [a.width, a.height, b.width, b.height].into_iter().max().unwrap_or(0);
    (longest as f64 / 240.0).max(1.0)
}

/// Median distance of the matches to their epipolar lines, pixels; `None` without matches or baseline.
pub fn median_distance(a: &Camera, b: &Camera, matches: &[Match]) -> Option<f64> {
    let geometry = EpipolarGeometry::of(a, b)?;
    median(matches.iter().map(|m| geometry.distance(m)).collect())
}

/// True when both cameras stand at the same place, to the precision of the numbers.
pub fn has_no_baseline(a: &Camera, b: &Camera) -> bool {
    let baseline = (a.centre() - b.centre()).length();
    // Centres come from -R^T t, whose rounding grows with their distance from the origin.
    baseline <= 1e-9 * a.centre().length().max(b.centre().length())
}

/// The middle value (the upper of two); `None` of nothing.
pub(crate) fn median(values: Vec<f64>) -> Option<f64> {
    quantile(values, 0.5)
}

/// The value below which a share of the values lies; `None` of nothing.
pub(crate) fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let rank = (share * values.len() as f64) as usize;
    values.get(rank.min(values.len().saturating_sub(1))).copied()
}

fn unit_line(line: DVec3) -> Option<DVec3> {
    let length = line.truncate().length();
    (length > 0.0).then(|| line / length)
}

fn pixel_inverse(k: &Intrinsics) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(1.0 / k.fx, 0.0, 0.0),
        DVec3::new(0.0, 1.0 / k.fy, 0.0),
        DVec3::new(-k.cx / k.fx, -k.cy / k.fy, 1.0),
    )
}

fn cross_matrix(t: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, t.z, -t.y), DVec3::new(-t.z, 0.0, t.x), DVec3::new(t.y, -t.x, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_pairs::{noiseless, toed_in};

    #[test]
    fn true_matches_lie_on_their_lines_and_shifted_ones_do_not() {
        let (a, b) = toed_in(1.0);
        let geometry = EpipolarGeometry::of(&a, &b).expect("a baseline");
        for m in noiseless(&a, &b, 1.0) {
            assert!(geometry.distance(&m) < 1e-9);
            let line = geometry.line_in_b(m.a).expect("not the epipole");
            let shifted = Match { b: m.b + 3.0 * line.truncate(), ..m };
            assert!(geometry.distance(&shifted) >= 3.0 - 1e-9, "{}", geometry.distance(&shifted));
            let swapped = EpipolarGeometry::of(&b, &a).expect("a baseline").distance(&shifted.swapped());
            assert!((swapped - geometry.distance(&shifted)).abs() < 1e-6, "the distance is symmetric");
        }
    }

    #[test]
    fn one_place_has_no_lines_however_far_from_the_origin() {
        let (a, _) = toed_in(1.0);
        let far = surfel_core::Rigid { translation: DVec3::splat(1e6), ..surfel_core::Rigid::IDENTITY };
        let away = Camera { camera_from_world: a.camera_from_world * far, ..a };
        assert_eq!(EpipolarGeometry::of(&a, &a), None);
        assert_eq!(EpipolarGeometry::of(&away, &away), None);
    }
}
