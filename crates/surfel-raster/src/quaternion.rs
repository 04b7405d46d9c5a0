//! Rotation matrices of unit quaternions, and the way back for gradients (spec 1.4, 3.7).
//!
//! Quaternions are `w x y z`; the columns of the matrix are the surfel's `t_u, t_v, t_w`.

use glam::{DMat3, DVec3, DVec4};

/// Shorter quaternions have no direction worth trusting.
const MIN_LENGTH: f64 = 1e-12;

/// Unit quaternion and the length it had; `None` for zero or not finite.
pub fn normalise(raw: [f64; 4]) -> Option<([f64; 4], f64)> {
    let length = DVec4::from(raw).length();
    (length.is_finite() && length > MIN_LENGTH).then(|| (raw.map(|c| c / length), length))
}

/// The rotation matrix of a unit quaternion.
pub fn to_matrix([w, x, y, z]: [f64; 4]) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        DVec3::new(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        DVec3::new(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
}

/// Gradient of a unit quaternion from the gradient of its matrix, ignoring the unit constraint.
pub fn unit_grad([w, x, y, z]: [f64; 4], d_matrix: &DMat3) -> [f64; 4] {
    let b = |row: usize, column: usize| d_matrix.col(column)[row];
    let (wx, wy, wz) = (b(2, 1) - b(1, 2), b(0, 2) - b(2, 0), b(1, 0) - b(0, 1));
    let (xy, xz, yz) = (b(1, 0) + b(0, 1), b(2, 0) + b(0, 2), b(2, 1) + b(1, 2));
    [
        2.0 * (x * wx + y * wy + z * wz),
        2.0 * (-2.0 * x * (b(1, 1) + b(2, 2)) + y * xy + z * xz + w * wx),
        2.0 * (x * xy - 2.0 * y * (b(0, 0) + b(2, 2)) + z * yz + w * wy),
        2.0 * (x * xz + y * yz - 2.0 * z * (b(0, 0) + b(1, 1)) + w * wz),
    ]
}

/// Gradient of the raw quaternion from that of its normalised form: `(I - q qᵀ) d / |q_raw|`.
pub fn raw_grad(unit: [f64; 4], length: f64, d_unit: [f64; 4]) -> [f64; 4] {
    let (q, d) = (DVec4::from(unit), DVec4::from(d_unit));
    ((d - q * q.dot(d)) / length).to_array()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrix_agrees_with_glam_and_gradient_with_differences() {
        let raw = [0.7, -1.2, 0.4, 2.0];
        let weights = DMat3::from_cols_array(&[0.3, -1.0, 0.8, 2.0, 0.1, -0.7, 1.1, 0.9, -0.2]);
        let loss = |raw: [f64; 4]| -> f64 {
            let (unit, _) = normalise(raw).expect("a usable quaternion");
            let matrix = to_matrix(unit);
            (0..3).map(|c| matrix.col(c).dot(weights.col(c))).sum()
        };
        let (unit, length) = normalise(raw).expect("a usable quaternion");
        let theirs = DMat3::from_quat(glam::DQuat::from_xyzw(unit[1], unit[2], unit[3], unit[0]));
        assert!(to_matrix(unit).abs_diff_eq(theirs, 1e-14));
        let grad = raw_grad(unit, length, unit_grad(unit, &weights));
        for i in 0..4 {
            let step = |h: f64| {
                let mut moved = raw;
                moved[i] += h;
                loss(moved)
            };
            let difference = (step(1e-6) - step(-1e-6)) / 2e-6;
            assert!((grad[i] - difference).abs() < 1e-8, "{i}: {} {difference}", grad[i]);
        }
    }

    #[test]
    fn zero_and_nan_have_no_direction() {
        assert!(normalise([0.0; 4]).is_none());
        assert!(normalise([f64::NAN, 0.0, 0.0, 1.0]).is_none());
    }
}
