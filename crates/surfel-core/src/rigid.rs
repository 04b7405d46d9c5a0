//! Rotation + translation between two frames, named `a_from_b` wherever it is stored.
//!
//! The invariant is that `rotation` is orthonormal with determinant +1;
//! [`Rigid::from_matrix`] is the gate through which outside numbers come in.

use glam::{DMat3, DMat4, DQuat, DVec3};

/// A rigid transform `x_a = rotation * x_b + translation`, in scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rigid {
    /// `a_from_b` rotation.
    pub rotation: DMat3,
    /// Origin of frame `b` expressed in frame `a`, scene units.
    pub translation: DVec3,
}

/// Why a matrix is not a rigid transform.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NotRigid {
    /// An entry is NaN or infinite.
    #[error("the pose has an entry that is not a finite number")]
    NotFinite,
    /// The 3x3 part is not orthonormal.
    #[error("the 3x3 part of the pose is not a rotation (R Rᵀ differs from the identity by {0:.3})")]
    NotOrthonormal(f64),
    /// The 3x3 part mirrors.
    #[error("the 3x3 part of the pose is a mirror (determinant {0:.3}, must be +1)")]
    Mirror(f64),
}

impl Rigid {
    /// The transform that changes nothing.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// How far `R Rᵀ` may be from the identity and still be taken for a rotation written with few digits.
    pub const ORTHONORMAL_TOLERANCE: f64 = 1e-2;

    /// From a unit quaternion and a translation.
    pub fn from_quat(rotation: DQuat, translation: DVec3) -> Self {
        Self { rotation: DMat3::from_quat(rotation.normalize()), translation }
    }

    /// From a 3x3 part and a translation that may carry rounding; re-orthonormalised.
    ///
    /// # Errors
    /// [`NotRigid`] when the numbers are not finite, not a rotation within
    /// [`Self::ORTHONORMAL_TOLERANCE`], or a mirror.
    pub fn from_matrix(rotation: DMat3, translation: DVec3) -> Result<Self, NotRigid> {
        if !rotation.is_finite() || !translation.is_finite() {
            return Err(NotRigid::NotFinite);
        }
        let error = (rotation * rotation.transpose() - DMat3::IDENTITY)
            .to_cols_array()
            .iter()
            .fold(0.0f64, |worst, entry| worst.max(entry.abs()));
        if error > Self::ORTHONORMAL_TOLERANCE {
            return Err(NotRigid::NotOrthonormal(error));
        }
        let determinant = rotation.determinant();
        if determinant < 0.0 {
            return Err(NotRigid::Mirror(determinant));
        }
        Ok(Self { rotation: nearest_rotation(rotation), translation })
    }

    /// `x_a` of a point `x_b`.
    pub fn transform(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// `b_from_a`.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// `self` after `other`: `a_from_b.compose(&b_from_c)` is `a_from_c`, also written `a_from_b * b_from_c`.
    pub fn compose(&self, other: &Self) -> Self {
        Self { rotation: self.rotation * other.rotation, translation: self.transform(other.translation) }
    }

    /// As a homogeneous 4x4 matrix.
    pub fn to_mat4(&self) -> DMat4 {
        DMat4::from_cols(
            self.rotation.x_axis.extend(0.0),
            self.rotation.y_axis.extend(0.0),
            self.rotation.z_axis.extend(0.0),
            self.translation.extend(1.0),
        )
    }
}

impl std::ops::Mul for Rigid {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        self.compose(&other)
    }
}

/// Newton's iteration for the orthogonal polar factor; quadratic, so four steps suffice near a rotation.
fn nearest_rotation(matrix: DMat3) -> DMat3 {
    (0..4).fold(matrix, |m, _| (m + m.inverse().transpose()) * 0.5)
}
