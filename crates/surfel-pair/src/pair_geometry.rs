//! How well two views suit each other, as far as cameras and sparse points can tell.
//!
//! The short-listing half of [`crate::choose`]. The invariant: a pair is described by angles and shares
//! only, so pairs of different scenes may be compared and the unit of length does not matter.

use crate::epipolar::{has_no_baseline, median};
use crate::frustum::overlap;
use glam::{DMat3, DVec3};
use surfel_core::Camera;

/// Triangulation angles, degrees, at which depth is well measured and patches still look alike.
const BEST_ANGLE: std::ops::RangeInclusive<f64> = 5.0..=15.0;
/// Beyond the best angles the score falls like a Gaussian of this width, degrees.
const ANGLE_FALLOFF: f64 = 12.0;
/// The same for the angle between the optical axes, degrees.
const DIRECTION_FALLOFF: f64 = 35.0;
/// Shared points needed before they replace the guess from the optical axes.
const MIN_SHARED_POINTS: usize = 12;
/// Optical axes whose mean angle is below about a degree meet nowhere in particular.
const PARALLEL_AXES: f64 = 1e-4;

/// A point of the scene that came with the cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct SparsePoint {
    /// Position, world frame, scene units.
    pub position: DVec3,
    /// Indices of the cameras that saw it; empty when the file does not say.
    pub seen_by: Vec<usize>,
}

/// What relates two views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairGeometry {
    /// Angle between the rays at the scene, degrees; `None` when the depth of the scene is unknown.
    pub angle_deg: Option<f64>,
    /// Share in \[0, 1\] of what one view sees that the other sees too.
    pub overlap: f64,
    /// Angle between the optical axes, degrees.
    pub direction_deg: f64,
    /// How large the scene appears in one view relative to the other, the smaller over the larger, in (0, 1\].
    pub scale: f64,
}

impl PairGeometry {
    /// Worth of the pair in \[0, 1\].
    pub fn score(&self) -> f64 {
        // An unknown angle is neither praised nor condemned.
        let angle = self.angle_deg.map_or(0.5, angle_score);
        angle * self.overlap * self.scale * gaussian(self.direction_deg / DIRECTION_FALLOFF)
    }
}

/// Worth of a triangulation angle in \[0, 1\]: none at 0, full from 5 to 15 degrees, little beyond 35.
pub fn angle_score(degrees: f64) -> f64 {
    let (low, high) = BEST_ANGLE.into_inner();
    match degrees {
        _ if degrees < low => degrees / low,
        _ if degrees > high => gaussian((degrees - high) / ANGLE_FALLOFF),
        _ => 1.0,
    }
}

fn gaussian(x: f64) -> f64 {
    (-x * x).exp()
}

/// All cameras of a capture with what is known of the scene between them.
pub struct Capture<'a> {
    cameras: &'a [Camera],
    points: &'a [SparsePoint],
    /// Points seen by each camera.
    seen: Vec<Vec<usize>>,
    centre: Option<DVec3>,
}

impl<'a> Capture<'a> {
    /// Prepares the lookups; `points` may be empty.
    pub fn new(cameras: &'a [Camera], points: &'a [SparsePoint]) -> Self {
        let sees = |i: usize, point: &SparsePoint| match point.seen_by.is_empty() {
            true => cameras[i].project(point.position).is_some_and(|(pixel, _)| cameras[i].contains(pixel)),
            false => point.seen_by.contains(&i),
        };
        let seen = (0..cameras.len()).map(|i| (0..points.len()).filter(|&p| sees(i, &points[p])).collect()).collect();
        let all: Vec<&Camera> = cameras.iter().collect();
        let centre = axes_meeting_point(&all);
        Self { cameras, points, seen, centre }
    }

    /// Relates two views; `None` when they stand at the same place or look away from each other.
    pub fn pair(&self, i: usize, j: usize) -> Option<PairGeometry> {
        let (a, b) = (&self.cameras[i], &self.cameras[j]);
        let direction_deg = a.forward().angle_between(b.forward()).to_degrees();
        if has_no_baseline(a, b) || direction_deg > 90.0 {
            return None;
        }
        let shared: Vec<DVec3> = sorted_intersection(&self.seen[i], &self.seen[j])
            .into_iter()
            .map(|p| self.points[p].position)
            .filter(|&p| a.project(p).is_some() && b.project(p).is_some())
            .collect();
        if shared.len() >= MIN_SHARED_POINTS {
            let fewer = self.seen[i].len().min(self.seen[j].len());
            return Some(PairGeometry {
                angle_deg: median(shared.iter().map(|&p| angle_at(a, b, p)).collect()),
                overlap: shared.len() as f64 / fewer as f64,
                direction_deg,
                scale: median(shared.iter().map(|&p| scale_at(a, b, p)).collect())?,
            });
        }
        let in_front = |point: &DVec3| a.project(*point).is_some() && b.project(*point).is_some();
        let centre = self.centre.or_else(|| axes_meeting_point(&[a, b])).filter(in_front);
        let baseline = (a.centre() - b.centre()).length();
        // Where the rays would meet at 8 degrees, when nobody knows where the scene is.
        let depth = centre.map_or(7.0 * baseline, |c| 0.5 * ((c - a.centre()).length() + (c - b.centre()).length()));
        Some(PairGeometry {
            angle_deg: centre.map(|c| angle_at(a, b, c)),
            overlap: overlap(a, b, 0.7 * depth, 1.4 * depth),
            direction_deg,
            scale: centre.map_or(1.0, |c| scale_at(a, b, c)),
        })
    }
}

/// Point nearest to all optical axes (least squares), world frame; `None` when they are parallel or it lies
/// behind a camera, as for views that look outwards.
pub fn axes_meeting_point(cameras: &[&Camera]) -> Option<DVec3> {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for camera in cameras {
        let axis = camera.forward();
        let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        normal += across;
        right += across * camera.centre();
    }
    let num = cameras.len() as f64;
    // The two large eigenvalues are near 1, so the determinant is about the smallest one.
    if (normal * (1.0 / num)).determinant() < PARALLEL_AXES {
        return None;
    }
    let point = normal.inverse() * right;
    cameras.iter().all(|camera| camera.project(point).is_some()).then_some(point)
}

fn angle_at(a: &Camera, b: &Camera, point: DVec3) -> f64 {
    (point - a.centre()).angle_between(point - b.centre()).to_degrees()
}

fn scale_at(a: &Camera, b: &Camera, point: DVec3) -> f64 {
    // Focal length in image widths, so that photographs of two sizes compare.
    let size = |camera: &Camera| {
        let away = (point - camera.centre()).length();
        camera.intrinsics.mean_focal() / (camera.width.max(camera.height) as f64 * away)
    };
    let ratio = size(a) / size(b);
    ratio.min(1.0 / ratio)
}

fn sorted_intersection(a: &[usize], b: &[usize]) -> Vec<usize> {
    let (mut i, mut j, mut both) = (0, 0, Vec::new());
    while i < a.len() && j < b.len() {
        match a[i].cmp(&b[j]) {
            std::cmp::Ordering::Less => i += 1,
            std::cmp::Ordering::Greater => j += 1,
            std::cmp::Ordering::Equal => {
                both.push(a[i]);
                i += 1;
                j += 1;
            }
        }
    }
    both
}
