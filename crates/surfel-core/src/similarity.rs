//! Rotation, translation and uniform scale between two world frames.
//!
//! The pipeline computes in a *working* frame (origin near the cameras, unit-sized) so that nothing
//! depends on the unit of the scene; results go back through the inverse. Invariant: `scale > 0`.

use crate::Rigid;
use glam::{DMat3, DVec3};

/// `x_a = scale * rotation * x_b + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Units of `a` per unit of `b`.
    pub scale: f64,
    /// `a_from_b` rotation.
    pub rotation: DMat3,
    /// Origin of `b` in `a`.
    pub translation: DVec3,
}

impl Similarity {
    /// The transform that changes nothing.
    pub const IDENTITY: Self = Self { scale: 1.0, rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// `x_a` of a point `x_b`.
    pub fn transform(&self, point: DVec3) -> DVec3 {
        self.rotation * point * self.scale + self.translation
    }

    /// `b_from_a`.
    pub fn inverse(&self) -> Self {
        let (scale, rotation) = (1.0 / self.scale, self.rotation.transpose());
        Self { scale, rotation, translation: rotation * -self.translation * scale }
    }

    /// `camera_from_a` for a `camera_from_b`: depths are multiplied by `scale`, images stay the same.
    pub fn carry_camera(&self, camera_from_b: &Rigid) -> Rigid {
        let rotation = camera_from_b.rotation * self.rotation.transpose();
        Rigid { rotation, translation: camera_from_b.translation * self.scale - rotation * self.translation }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn inverse_undoes_and_cameras_keep_their_picture() {
        let a_from_b = Similarity {
            scale: 3.5,
            rotation: DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.0, 0.2)),
            translation: DVec3::new(1.0, -2.0, 7.0),
        };
        let p = DVec3::new(0.2, 0.5, -0.9);
        assert!((a_from_b.inverse().transform(a_from_b.transform(p)) - p).length() < 1e-12);
        let camera_from_b = Rigid::from_quat(DQuat::from_rotation_y(0.4), DVec3::new(0.1, 0.2, 5.0));
        let camera_from_a = a_from_b.carry_camera(&camera_from_b);
        let (in_b, in_a) = (camera_from_b.transform(p), camera_from_a.transform(a_from_b.transform(p)));
        assert!((in_a - in_b * 3.5).length() < 1e-12);
    }
}
