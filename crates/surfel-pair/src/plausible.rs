//! Checks that need no picture: whether two cameras could belong to photographs of one scene at all.
//!
//! Runs before and beside the evidence of matches in [`crate::sanity`]. The invariant: every remark
//! is relative (angles, shares of the image, ratios of lengths), so no scene size is assumed.

use crate::Match;
use crate::epipolar::has_no_baseline;
use crate::frustum::overlap;
use crate::mistake::NORMALISED_FOCAL;
use crate::triangulate::triangulate;
use glam::DVec2;
use surfel_core::Camera;

/// Fields of view outside this range, degrees, are no photographs of a pinhole camera.
const FIELD_OF_VIEW: std::ops::RangeInclusive<f64> = 2.0..=150.0;
/// Largest distance of the principal point from the image centre, in shares of the image side; shift
/// lenses and crops stay below.
const MAX_PRINCIPAL_OFFSET: f64 = 0.3;

/// What is odd about a pair of cameras, as geometry alone can tell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Oddity {
    /// A number of the intrinsics or the pose is not finite, or a focal length is not positive.
    NotACamera,
    /// The focal lengths are those of normalised intrinsics.
    Normalised,
    /// Horizontal or vertical field of view, degrees.
    FieldOfView(f64),
    /// Offset of the principal point from the image centre, in shares of the image side.
    PrincipalPoint(f64),
    /// Both cameras stand at the same place.
    NoBaseline,
    /// Neither camera's image can contain what the other sees.
    NothingInCommon,
}

impl Oddity {
    /// The remark as a sentence.
    pub fn sentence(self) -> String {
        match self {
            Self::NotACamera => {
                "A camera has a focal length that is not positive or a number that is not finite.".into()
            }
            Self::Normalised => "The focal length is below 10 pixels: the intrinsics look normalised.".into(),
            Self::FieldOfView(degrees) => {
                format!("The field of view is {degrees:.1} degrees: the focal length does not fit the image size.")
            }
            Self::PrincipalPoint(share) => format!(
                "The principal point lies {:.0} % of the image away from its centre: the intrinsics may belong to \
                 another image size.",
                100.0 * share
            ),
            Self::NoBaseline => {
                "Both cameras stand at the same place: without a baseline no depth can be measured.".into()
            }
            Self::NothingInCommon => "The cameras look away from each other: they see nothing in common.".into(),
        }
    }
}

/// Lists what is odd, the gravest first; empty for plausible cameras.
pub fn oddities(a: &Camera, b: &Camera) -> Vec<Oddity> {
    if !is_camera(a) || !is_camera(b) {
        return vec![Oddity::NotACamera];
    }
    let mut found = Vec::new();
    if has_no_baseline(a, b) {
        found.push(Oddity::NoBaseline);
    }
    if [a, b].iter().any(|camera| camera.intrinsics.mean_focal() < NORMALISED_FOCAL) {
        found.push(Oddity::Normalised);
        return found;
    }
    if overlap(a, b, 0.0, f64::INFINITY) == 0.0 {
        found.push(Oddity::NothingInCommon);
    }
    let fields = [a, b].into_iter().flat_map(fields_of_view);
    found.extend(fields.filter(|degrees| !FIELD_OF_VIEW.contains(degrees)).map(Oddity::FieldOfView).take(1));
    let offset = principal_offset(a).max(principal_offset(b));
    if offset > MAX_PRINCIPAL_OFFSET {
        found.push(Oddity::PrincipalPoint(offset));
    }
    found
}

/// True when the optical axes come nearest to each other clearly behind both cameras. Views that look outwards do
/// so too: odd only together with matches that disagree.
pub(crate) fn axes_diverge(a: &Camera, b: &Camera) -> bool {
    let principal = |camera: &Camera| DVec2::new(camera.intrinsics.cx, camera.intrinsics.cy);
    let axes = Match { a: principal(a), b: principal(b), score: 0.0 };
    triangulate(a, b, &axes).is_some_and(|t| t.parallax > 2f64.to_radians() && t.depth_a < 0.0 && t.depth_b < 0.0)
}

fn is_camera(camera: &Camera) -> bool {
    let k = &camera.intrinsics;
    let numbers = [k.fx, k.fy, k.cx, k.cy];
    numbers.iter().all(|v| v.is_finite())
        && k.fx > 0.0
        && k.fy > 0.0
        && camera.camera_from_world.rotation.is_finite()
        && camera.camera_from_world.translation.is_finite()
}

fn fields_of_view(camera: &Camera) -> [f64; 2] {
    let k = &camera.intrinsics;
    let degrees = |side: usize, focal: f64| 2.0 * (0.5 * side as f64 / focal).atan().to_degrees();
    [degrees(camera.width, k.fx), degrees(camera.height, k.fy)]
}

/// Distance of the principal point from the image centre, in shares of the image side.
pub(crate) fn principal_offset(camera: &Camera) -> f64 {
    let k = &camera.intrinsics;
    (k.cx / camera.width as f64 - 0.5).abs().max((k.cy / camera.height as f64 - 0.5).abs())
}
