//! Real spherical harmonics in the 3DGS basis, degree 0 to 3, and their exact rotation (spec 1.5, 3.7).
//!
//! Coefficient `(l, m)` sits at `l² + l + m`. Colour is `max(0, sum + 0.5)`. Invariant:
//! `basis(R^T d) . c == basis(d) . rotate(R, c)` for every direction and rotation.

use glam::{DMat3, DVec3};

/// The constant of band 0: a colour `c` is stored as `(c - 0.5) / C0`.
pub const C0: f64 = 0.282_094_791_773_878_14;
const C1: f64 = 0.488_602_511_902_919_9;
const C2: [f64; 5] = [
    1.092_548_430_592_079_2,
    -1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    -1.092_548_430_592_079_2,
    0.546_274_215_296_039_6,
];
const C3: [f64; 7] = [
    -0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    -0.457_045_799_464_465_8,
    0.373_176_332_590_115_4,
    -0.457_045_799_464_465_8,
    1.445_305_721_320_277,
    -0.590_043_589_926_643_5,
];

/// Highest supported degree.
pub const MAX_DEGREE: usize = 3;

/// Number of coefficients per channel up to `degree`.
pub const fn num_coefficients(degree: usize) -> usize {
    (degree + 1) * (degree + 1)
}

/// All 16 basis functions at the unit direction `d`; degrees above the one in use are simply ignored.
pub fn basis(d: DVec3) -> [f64; 16] {
    let DVec3 { x, y, z } = d;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        C0,
        -C1 * y,
        C1 * z,
        -C1 * x,
        C2[0] * x * y,
        C2[1] * y * z,
        C2[2] * (2.0 * zz - xx - yy),
        C2[3] * x * z,
        C2[4] * (xx - yy),
        C3[0] * y * (3.0 * xx - yy),
        C3[1] * x * y * z,
        C3[2] * y * (4.0 * zz - xx - yy),
        C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        C3[4] * x * (4.0 * zz - xx - yy),
        C3[5] * z * (xx - yy),
        C3[6] * x * (xx - 3.0 * yy),
    ]
}

/// The SH coefficient of band 0 that shows the sRGB colour `colour` in \[0, 1\].
pub fn from_colour(colour: [f32; 3]) -> [f32; 3] {
    colour.map(|c| ((f64::from(c) - 0.5) / C0) as f32)
}

/// The sRGB colour in \[0, 1\] of a band-0 coefficient, clamped at 0.
pub fn to_colour(coefficient: [f32; 3]) -> [f32; 3] {
    coefficient.map(|c| (f64::from(c) * C0 + 0.5).max(0.0) as f32)
}

/// Rotation matrices `D_l` of bands 1 to 3 for `world_from_camera`, one per view (spec 1.5).
///
/// Fitted exactly from samples: `D_l = pinv(A_l) [B_l(Rᵀ d_i)]` with `A_l = [B_l(d_i)]`.
#[derive(Clone, Debug)]
pub struct ShRotation {
    /// `bands[l - 1]` is a row-major `(2l+1) x (2l+1)` matrix.
    bands: [Vec<f64>; MAX_DEGREE],
}

impl ShRotation {
    /// The rotation of coefficients given in frame `b` to frame `a`, for `a_from_b`.
    pub fn new(a_from_b: DMat3) -> Self {
        Self { bands: std::array::from_fn(|i| band_rotation(i + 1, a_from_b)) }
    }

    /// Rotates one channel's coefficients in place; `coefficients.len()` is `(degree + 1)²`.
    pub fn apply(&self, coefficients: &mut [f64]) {
        for (i, matrix) in self.bands.iter().enumerate() {
            let l = i + 1;
            let (start, n) = (l * l, 2 * l + 1);
            if coefficients.len() < start + n {
                return;
            }
            let band: Vec<f64> = coefficients[start..start + n].to_vec();
            for (row, out) in coefficients[start..start + n].iter_mut().enumerate() {
                *out = (0..n).map(|col| matrix[row * n + col] * band[col]).sum();
            }
        }
    }
}

fn band_rotation(l: usize, a_from_b: DMat3) -> Vec<f64> {
    let n = 2 * l + 1;
    let directions: Vec<DVec3> = (0..3 * n).map(|i| generic_direction(i, 3 * n)).collect();
    let band = |d: DVec3| basis(d)[l * l..l * l + n].to_vec();
    let sampled: Vec<Vec<f64>> = directions.iter().map(|&d| band(d)).collect();
    let rotated: Vec<Vec<f64>> = directions.iter().map(|&d| band(a_from_b.transpose() * d)).collect();
    // Normal equations (AᵀA) D = AᵀB; A is well conditioned for spread directions.
    let product = |left: &[Vec<f64>], right: &[Vec<f64>]| -> Vec<f64> {
        let mut out = vec![0.0; n * n];
        for (a, b) in left.iter().zip(right) {
            for r in 0..n {
                for c in 0..n {
                    out[r * n + c] += a[r] * b[c];
                }
            }
        }
        out
    };
    solve(product(&sampled, &sampled), product(&sampled, &rotated), n)
}

/// Points of a Fibonacci spiral: spread, and in no special position to the axes.
fn generic_direction(i: usize, count: usize) -> DVec3 {
    let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
    let angle = 2.399_963 * i as f64 + 0.7;
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * angle.cos(), r * angle.sin(), z)
}

/// Solves `M X = B` for row-major `n x n` matrices by Gauss-Jordan elimination with pivoting.
fn solve(mut m: Vec<f64>, mut b: Vec<f64>, n: usize) -> Vec<f64> {
    for col in 0..n {
        let pivot = (col..n).max_by(|&i, &j| m[i * n + col].abs().total_cmp(&m[j * n + col].abs())).unwrap_or(col);
        for k in 0..n {
            m.swap(col * n + k, pivot * n + k);
            b.swap(col * n + k, pivot * n + k);
        }
        let inverse = 1.0 / m[col * n + col];
        for k in 0..n {
            m[col * n + k] *= inverse;
            b[col * n + k] *= inverse;
        }
        for row in (0..n).filter(|&row| row != col) {
            let factor = m[row * n + col];
            for k in 0..n {
                m[row * n + k] -= factor * m[col * n + k];
                b[row * n + k] -= factor * b[col * n + k];
            }
        }
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn rotated_coefficients_show_the_rotated_colour() {
        let a_from_b = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 0.7, -0.4, 2.1));
        let rotation = ShRotation::new(a_from_b);
        let in_b: Vec<f64> = (0..16).map(|i| ((i * 37 % 11) as f64 - 5.0) / 5.0).collect();
        let mut in_a = in_b.clone();
        rotation.apply(&mut in_a);
        for i in 0..20 {
            let d_a = generic_direction(i, 20);
            let show = |c: &[f64], d: DVec3| basis(d).iter().zip(c).map(|(b, c)| b * c).sum::<f64>();
            assert!((show(&in_a, d_a) - show(&in_b, a_from_b.transpose() * d_a)).abs() < 1e-12);
        }
    }

    #[test]
    fn colour_round_trips() {
        let colour = [0.1, 0.5, 0.93];
        let back = to_colour(from_colour(colour));
        assert!(colour.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-6));
    }
}
