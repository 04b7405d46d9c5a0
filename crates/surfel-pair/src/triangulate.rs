//! The point of the scene behind a match: where two rays come nearest to each other.
//!
//! Used to bound the depth and to ask on which side of the cameras the scene lies (cheirality). The
//! invariant: depths are signed z-depths, so a point behind a camera is reported, never dropped.

use crate::Match;
use glam::{DVec2, DVec3};
use surfel_core::Camera;

/// A match turned into a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangulated {
    /// Middle of the shortest segment between the two rays, world frame, scene units.
    pub point: DVec3,
    /// z-depth along the ray of view a, scene units; negative behind the camera.
    pub depth_a: f64,
    /// z-depth along the ray of view b, scene units; negative behind the camera.
    pub depth_b: f64,
    /// Angle between the two rays, radians.
    pub parallax: f64,
    /// The larger of the two reprojection errors, pixels; infinite behind a camera.
    pub reprojection_px: f64,
}

/// On which side of both cameras a match lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// In front of both.
    Front,
    /// Behind at least one: something about the poses is wrong.
    Behind,
    /// The rays are parallel within a pixel: too far to say.
    TooFar,
}

/// Intersects the rays of a match; `None` when they are parallel.
pub fn triangulate(a: &Camera, b: &Camera, m: &Match) -> Option<Triangulated> {
    let ray_a = a.camera_from_world.rotation.transpose() * a.ray(m.a);
    let ray_b = b.camera_from_world.rotation.transpose() * b.ray(m.b);
    let baseline = b.centre() - a.centre();
    let parallax = ray_a.angle_between(ray_b);

    // Normal equations of |depth_a ray_a - depth_b ray_b - baseline|^2.
    let (aa, ab, bb) = (ray_a.length_squared(), ray_a.dot(ray_b), ray_b.length_squared());
    let determinant = aa * bb - ab * ab;
    if determinant <= 1e-14 * aa * bb {
        return None;
    }
    let (along_a, along_b) = (ray_a.dot(baseline), ray_b.dot(baseline));
    let depth_a = (bb * along_a - ab * along_b) / determinant;
    let depth_b = (ab * along_a - aa * along_b) / determinant;
    let point = 0.5 * (a.centre() + depth_a * ray_a + b.centre() + depth_b * ray_b);
    let error = |camera: &Camera, pixel: DVec2| {
        camera.project(point).map_or(f64::INFINITY, |(projected, _)| (projected - pixel).length())
    };
    let reprojection_px = error(a, m.a).max(error(b, m.b));
    Some(Triangulated { point, depth_a, depth_b, parallax, reprojection_px })
}

/// Tells the side of a match; parallax under one pixel is noise.
pub fn side(a: &Camera, b: &Camera, m: &Match) -> Side {
    let pixel_angle = 1.0 / a.intrinsics.mean_focal().min(b.intrinsics.mean_focal());
    match triangulate(a, b, m) {
        Some(t) if t.parallax >= pixel_angle && (t.depth_a <= 0.0 || t.depth_b <= 0.0) => Side::Behind,
        Some(t) if t.parallax >= pixel_angle => Side::Front,
        _ => Side::TooFar,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_pairs::{noiseless, scene_points, toed_in};

    #[test]
    fn a_noiseless_match_gives_its_point_back() {
        let (a, b) = toed_in(1.0);
        for (m, point) in noiseless(&a, &b, 1.0).iter().zip(scene_points(1.0)) {
            let t = triangulate(&a, &b, m).expect("rays meet");
            assert!((t.point - point).length() < 1e-9);
            assert!((t.depth_a - a.project(point).expect("in front").1).abs() < 1e-9);
            assert!((t.depth_b - b.project(point).expect("in front").1).abs() < 1e-9);
            assert!(t.reprojection_px < 1e-6);
            assert_eq!(side(&a, &b, m), Side::Front);
        }
    }

    #[test]
    fn negated_baselines_put_the_scene_behind_and_parallel_rays_too_far() {
        let (a, b) = toed_in(1.0);
        let matches = noiseless(&a, &b, 1.0);
        let exchanged = |camera: &Camera, centre: DVec3| {
            let mut moved = *camera;
            moved.camera_from_world.translation = -(moved.camera_from_world.rotation * centre);
            moved
        };
        let (moved_a, moved_b) = (exchanged(&a, b.centre()), exchanged(&b, a.centre()));
        assert!(matches.iter().all(|m| side(&moved_a, &moved_b, m) == Side::Behind));

        let parallel = Camera { camera_from_world: surfel_core::Rigid::IDENTITY, ..a };
        let mut beside = parallel;
        beside.camera_from_world.translation.x = -1.0;
        let same_pixel = Match { a: DVec2::splat(100.0), b: DVec2::splat(100.0), score: 1.0 };
        assert_eq!(triangulate(&parallel, &beside, &same_pixel), None);
        assert_eq!(side(&parallel, &beside, &same_pixel), Side::TooFar);
    }
}
