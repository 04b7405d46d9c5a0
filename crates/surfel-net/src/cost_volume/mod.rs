//! The geometry of plane sweeping: who matches with whom, and where a pixel lands in its neighbour (spec 2.4.1).
//!
//! The correlation itself is the operator `ops::plane_sweep`. Invariant: scaling the scene and the depth
//! range together changes nothing but the unit of disparity.

pub mod neighbours;

use crate::ops::plane_sweep::{Base, Sweep, Warp};
use glam::{DMat3, DVec3};
use surfel_core::{Camera, Intrinsics};

/// The depths a view may contain, z-depth in scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthRange {
    /// Nearest, above 0.
    pub near: f64,
    /// Farthest, above `near`.
    pub far: f64,
}

impl DepthRange {
    /// True when the network can work with it.
    pub fn is_usable(&self) -> bool {
        self.near > 0.0 && self.far > self.near && self.far.is_finite()
    }

    /// Disparity of the far end, 1 / scene unit.
    pub fn far_disparity(&self) -> f64 {
        1.0 / self.far
    }

    /// Disparity between the far and the near end.
    pub fn disparity_span(&self) -> f64 {
        1.0 / self.near - 1.0 / self.far
    }
}

/// Candidates of the coarse sweep for one view, uniform in disparity, far first.
pub fn uniform_candidates(range: &DepthRange, count: usize) -> Vec<f32> {
    let fraction = |j: usize| j as f64 / (count - 1) as f64;
    (0..count).map(|j| (range.far_disparity() + fraction(j) * range.disparity_span()) as f32).collect()
}

/// The warps of maps with the given stride, whose pixel `i` stands over input pixel `stride i`.
pub fn warps(cameras: &[Camera], neighbours: &[Vec<usize>], stride: usize) -> Vec<Vec<Warp>> {
    let intrinsics = |camera: &Camera| {
        let Intrinsics { fx, fy, .. } = camera.intrinsics;
        let centre = camera.intrinsics.principal_index();
        let s = stride as f64;
        DMat3::from_cols(
            DVec3::new(fx / s, 0.0, 0.0),
            DVec3::new(0.0, fy / s, 0.0),
            DVec3::new(centre.x / s, centre.y / s, 1.0),
        )
    };
    let warp = |reference: usize, other: usize| {
        let other_from_reference = cameras[other].camera_from_world * cameras[reference].camera_from_world.inverse();
        let k = intrinsics(&cameras[other]);
        let rotation = k * other_from_reference.rotation * intrinsics(&cameras[reference]).inverse();
        let translation = k * other_from_reference.translation;
        let rows = [0, 1, 2].map(|i| rotation.row(i).as_vec3().to_array());
        Warp { other, rotation: rows, translation: translation.as_vec3().to_array() }
    };
    neighbours.iter().enumerate().map(|(r, others)| others.iter().map(|&o| warp(r, o)).collect()).collect()
}

/// A sweep over maps of `width` x `height` pixels.
pub fn sweep(warps: Vec<Vec<Warp>>, size: (usize, usize), disparities: Vec<Vec<f32>>, base: Base) -> Sweep {
    Sweep { width: size.0, height: size.1, warps, disparities, base }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec2};
    use surfel_core::Rigid;

    #[test]
    fn a_warp_lands_where_projection_lands() {
        let intrinsics = Intrinsics { fx: 90.0, fy: 95.0, cx: 41.0, cy: 30.5 };
        let camera = |angle: f64, x: f64| Camera {
            intrinsics,
            width: 80,
            height: 64,
            camera_from_world: Rigid::from_quat(DQuat::from_rotation_y(angle), DVec3::new(x, 0.1, -0.2)),
        };
        let cameras = [camera(0.0, 0.0), camera(0.2, -0.7)];
        let warp = &warps(&cameras, &[vec![1], vec![0]], 4)[0][0];
        let (index, depth) = (DVec2::new(7.0, 11.0), 3.7);
        let world = cameras[0].unproject(index * 4.0 + 0.5, depth);
        let (expected, _) = cameras[1].project(world).unwrap();
        let q: [f64; 3] = std::array::from_fn(|i| {
            let r = warp.rotation[i].map(f64::from);
            r[0] * index.x + r[1] * index.y + r[2] + f64::from(warp.translation[i]) / depth
        });
        let landed = DVec2::new(q[0] / q[2], q[1] / q[2]) * 4.0 + 0.5;
        assert!((landed - expected).length() < 1e-4, "{landed} vs {expected}");
    }
}
