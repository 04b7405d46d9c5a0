//! What two cameras see in common, from geometry alone.
//!
//! The ray of a pixel, seen by another camera, is inside that camera's image over one interval of
//! depth, found by clipping against five planes. The invariant: no pixel value and no scene point is
//! used, so the answers hold before any photograph has been opened.

use glam::{DVec2, DVec3};
use surfel_core::Camera;

/// Rays per image side in a census of a view.
const RAYS_PER_SIDE: usize = 12;

/// Depths of a pixel of `a`, `(nearest, farthest)` z-depth in scene units, at which `b` has it inside
/// its image; `farthest` may be infinite. `None` when `b` never sees it.
pub fn visible_depths(a: &Camera, b: &Camera, pixel: DVec2) -> Option<(f64, f64)> {
    let b_from_a = b.camera_from_world * a.camera_from_world.inverse();
    let (direction, start) = (b_from_a.rotation * a.ray(pixel), b_from_a.translation);
    let k = &b.intrinsics;
    let (right, bottom) = (b.width as f64 - k.cx, b.height as f64 - k.cy);
    // Inward normals of the camera plane and the four sides of the frustum of `b`.
    let inward = [
        DVec3::Z,
        DVec3::new(k.fx, 0.0, k.cx),
        DVec3::new(-k.fx, 0.0, right),
        DVec3::new(0.0, k.fy, k.cy),
        DVec3::new(0.0, -k.fy, bottom),
    ];
    let (mut nearest, mut farthest) = (0.0f64, f64::INFINITY);
    for normal in inward {
        let (slope, offset) = (normal.dot(direction), normal.dot(start));
        match slope {
            _ if slope > 0.0 => nearest = nearest.max(-offset / slope),
            _ if slope < 0.0 => farthest = farthest.min(-offset / slope),
            _ if offset < 0.0 => return None,
            _ => {}
        }
    }
    (nearest < farthest).then_some((nearest, farthest))
}

/// [`visible_depths`] over an even grid of pixels of `a`; `None` entries are kept.
pub fn census(a: &Camera, b: &Camera) -> Vec<Option<(f64, f64)>> {
    let step = DVec2::new(a.width as f64, a.height as f64) / RAYS_PER_SIDE as f64;
    let pixels = (0..RAYS_PER_SIDE * RAYS_PER_SIDE)
        .map(|i| DVec2::new((i % RAYS_PER_SIDE) as f64 + 0.5, (i / RAYS_PER_SIDE) as f64 + 0.5) * step);
    pixels.map(|pixel| visible_depths(a, b, pixel)).collect()
}

/// Share in \[0, 1\] of the pixels of either view (the smaller share of the two) that the other can
/// see at some depth within `near..far`, z-depths in scene units.
pub fn overlap(a: &Camera, b: &Camera, near: f64, far: f64) -> f64 {
    let share = |from: &Camera, to: &Camera| {
        let rays = census(from, to);
        let seen = rays.iter().flatten().filter(|(lo, hi)| *lo < far && *hi > near).count();
        seen as f64 / rays.len() as f64
    };
    share(a, b).min(share(b, a))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_pairs::toed_in;

    /// The slow obvious twin: walk along the ray.
    #[test]
    fn clipping_agrees_with_walking_along_the_ray() {
        let (a, b) = toed_in(1.0);
        for pixel in [DVec2::new(3.0, 5.0), DVec2::new(240.0, 180.0), DVec2::new(470.0, 350.0)] {
            let range = visible_depths(&a, &b, pixel);
            for step in 1..400 {
                let depth = 0.05 * step as f64;
                let walked = b.project(a.unproject(pixel, depth)).is_some_and(|(p, _)| b.contains(p));
                let clipped = range.is_some_and(|(near, far)| near < depth && depth < far);
                assert_eq!(walked, clipped, "pixel {pixel}, depth {depth}, range {range:?}");
            }
        }
    }

    #[test]
    fn opposite_views_share_nothing_and_equal_ones_everything() {
        let (a, _) = toed_in(1.0);
        let mut back = a;
        back.camera_from_world.rotation =
            glam::DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0)) * back.camera_from_world.rotation;
        back.camera_from_world.translation = -(back.camera_from_world.rotation * (a.centre() - a.forward()));
        assert_eq!(overlap(&a, &back, 0.0, f64::INFINITY), 0.0);
        assert_eq!(overlap(&a, &a, 1.0, 2.0), 1.0);
    }
}
