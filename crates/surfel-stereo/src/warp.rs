//! Where a reference pixel at a given inverse depth falls in a source view.
//!
//! The geometric core of the plane sweep (spec 2.4.1) and of the refinement. Everything is in *index*
//! coordinates (first pixel centre at 0). Invariant: the homogeneous source pixel is linear in inverse
//! depth, `q = A (x, y, 1) + w b`, so that a plane in space is an affine function `w(x, y)`.

use glam::{DMat3, DVec3};
use surfel_core::Camera;

/// The map (reference pixel, inverse depth) -> source pixel of one pair of cameras.
#[derive(Clone, Copy, Debug)]
pub struct Warp {
    at_infinity: DMat3,
    parallax: DVec3,
}

/// A source pixel and how fast it moves with inverse depth.
#[derive(Clone, Copy, Debug)]
pub struct Landing {
    /// Index coordinates in the source view.
    pub x: f64,
    /// Index coordinates in the source view.
    pub y: f64,
    /// Source z-depth over reference z-depth; the point is behind the source camera when <= 0.
    pub relative_depth: f64,
}

impl Warp {
    /// The warp from `reference` to `source`.
    pub fn new(reference: &Camera, source: &Camera) -> Self {
        let source_from_reference = source.camera_from_world * reference.camera_from_world.inverse();
        let k_source = index_matrix(source);
        Self {
            at_infinity: k_source * source_from_reference.rotation * index_matrix(reference).inverse(),
            parallax: k_source * source_from_reference.translation,
        }
    }

    /// Homogeneous source pixel of reference index pixel `(x, y)` at infinity: add `w *` [`Self::parallax`].
    pub fn at_infinity(&self, x: f64, y: f64) -> DVec3 {
        self.at_infinity * DVec3::new(x, y, 1.0)
    }

    /// Change of the homogeneous source pixel per unit of inverse depth.
    pub fn parallax(&self) -> DVec3 {
        self.parallax
    }

    /// Source pixel of reference index pixel `(x, y)` at inverse depth `w`.
    pub fn land(&self, x: f64, y: f64, w: f64) -> Landing {
        let q = self.at_infinity(x, y) + self.parallax * w;
        let inverse = if q.z.abs() > 1e-12 { 1.0 / q.z } else { 0.0 };
        Landing { x: q.x * inverse, y: q.y * inverse, relative_depth: q.z }
    }

    /// Source pixels moved per unit of inverse depth at `(x, y, w)`; `None` behind the source camera.
    pub fn pixels_per_inverse_depth(&self, x: f64, y: f64, w: f64) -> Option<f64> {
        let q = self.at_infinity(x, y) + self.parallax * w;
        if q.z <= 1e-9 {
            return None;
        }
        let (px, py) = (q.x / q.z, q.y / q.z);
        let b = self.parallax;
        Some(((b.x - px * b.z).hypot(b.y - py * b.z)) / q.z)
    }
}

fn index_matrix(camera: &Camera) -> DMat3 {
    let (k, centre) = (&camera.intrinsics, camera.intrinsics.principal_index());
    DMat3::from_cols(DVec3::new(k.fx, 0.0, 0.0), DVec3::new(0.0, k.fy, 0.0), DVec3::new(centre.x, centre.y, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec2};
    use surfel_core::{Intrinsics, Rigid};

    #[test]
    fn lands_where_the_cameras_project() {
        let intrinsics = Intrinsics { fx: 300.0, fy: 310.0, cx: 161.0, cy: 120.5 };
        let camera = |rotation, translation| Camera {
            intrinsics,
            width: 320,
            height: 240,
            camera_from_world: Rigid::from_quat(rotation, translation),
        };
        let reference = camera(DQuat::from_rotation_x(0.1), DVec3::new(0.1, 0.0, 2.0));
        let source = camera(DQuat::from_euler(glam::EulerRot::XYZ, 0.1, -0.2, 0.05), DVec3::new(-0.3, 0.1, 2.1));
        let warp = Warp::new(&reference, &source);
        let depth = 1.7;
        let world = reference.unproject(DVec2::new(100.5, 80.5), depth);
        let (expected, z) = source.project(world).unwrap();
        let landing = warp.land(100.0, 80.0, 1.0 / depth);
        assert!((landing.x + 0.5 - expected.x).abs() < 1e-9 && (landing.y + 0.5 - expected.y).abs() < 1e-9);
        assert!((landing.relative_depth - z / depth).abs() < 1e-12);
        let step = 1e-6;
        let moved = warp.land(100.0, 80.0, 1.0 / depth + step);
        let speed = (moved.x - landing.x).hypot(moved.y - landing.y) / step;
        assert!((speed / warp.pixels_per_inverse_depth(100.0, 80.0, 1.0 / depth).unwrap() - 1.0).abs() < 1e-4);
    }
}
