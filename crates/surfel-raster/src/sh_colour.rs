//! View-dependent colour of a surfel and its gradient (spec 1.5, 3.7).
//!
//! `colour = max(0, sum_n c_n B_n(d) + 0.5)` with `d` the unit vector from the camera centre to the surfel.
//! Invariant: a channel clamped at 0 passes no gradient.

use glam::DVec3;
use surfel_core::sh;

/// Colour of coefficients seen along unit direction `d` (world, camera to surfel); `None` unless all are finite.
pub fn colour(coefficients: &[[f64; 3]], d: DVec3) -> Option<[f64; 3]> {
    let finite = coefficients.as_flattened().iter().all(|c| c.is_finite());
    finite.then(|| unclamped(coefficients, &sh::basis(d)).map(|c| c.max(0.0)))
}

fn unclamped(coefficients: &[[f64; 3]], basis: &[f64; 16]) -> [f64; 3] {
    let mut sum = [0.5; 3];
    for (coefficient, b) in coefficients.iter().zip(basis) {
        for channel in 0..3 {
            sum[channel] += coefficient[channel] * b;
        }
    }
    sum
}

/// Writes the gradients of the coefficients and returns that of the (unconstrained) direction.
pub fn colour_grad(coefficients: &[[f64; 3]], d: DVec3, d_colour: [f64; 3], d_coefficients: &mut [[f64; 3]]) -> DVec3 {
    let basis = sh::basis(d);
    let shown = unclamped(coefficients, &basis);
    let passed: [f64; 3] = std::array::from_fn(|channel| if shown[channel] > 0.0 { d_colour[channel] } else { 0.0 });
    let slopes = basis_slopes(d);
    let mut d_direction = DVec3::ZERO;
    for (n, out) in d_coefficients.iter_mut().enumerate() {
        *out = passed.map(|g| g * basis[n]);
        let along: f64 = (0..3).map(|channel| passed[channel] * coefficients[n][channel]).sum();
        d_direction += slopes[n] * along;
    }
    d_direction
}

/// Derivatives of [`sh::basis`] by `(x, y, z)`, coefficient by coefficient.
fn basis_slopes(d: DVec3) -> [DVec3; 16] {
    let DVec3 { x, y, z } = d;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let v = DVec3::new;
    let slope = |constant: f64, monomial: DVec3| monomial * constant;
    [
        DVec3::ZERO,
        slope(-C1, v(0.0, 1.0, 0.0)),
        slope(C1, v(0.0, 0.0, 1.0)),
        slope(-C1, v(1.0, 0.0, 0.0)),
        slope(C2[0], v(y, x, 0.0)),
        slope(-C2[0], v(0.0, z, y)),
        slope(C2[1], v(-2.0 * x, -2.0 * y, 4.0 * z)),
        slope(-C2[0], v(z, 0.0, x)),
        slope(C2[2], v(2.0 * x, -2.0 * y, 0.0)),
        slope(-C3[0], v(6.0 * x * y, 3.0 * (xx - yy), 0.0)),
        slope(C3[1], v(y * z, x * z, x * y)),
        slope(-C3[2], v(-2.0 * x * y, 4.0 * zz - xx - 3.0 * yy, 8.0 * y * z)),
        slope(C3[3], v(-6.0 * x * z, -6.0 * y * z, 6.0 * zz - 3.0 * (xx + yy))),
        slope(-C3[2], v(4.0 * zz - 3.0 * xx - yy, -2.0 * x * y, 8.0 * x * z)),
        slope(C3[4], v(2.0 * x * z, -2.0 * y * z, xx - yy)),
        slope(-C3[0], v(3.0 * (xx - yy), -6.0 * x * y, 0.0)),
    ]
}

const C1: f64 = 0.488_602_511_902_919_9;
const C2: [f64; 3] = [1.092_548_430_592_079_2, 0.315_391_565_252_520_05, 0.546_274_215_296_039_6];
const C3: [f64; 5] = [
    0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    0.457_045_799_464_465_8,
    0.373_176_332_590_115_4,
    1.445_305_721_320_277,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_agree_with_differences_of_the_shared_basis() {
        let d = DVec3::new(0.48, -0.6, 0.64);
        let slopes = basis_slopes(d);
        for axis in 0..3 {
            let step = |h: f64| {
                let mut moved = d;
                moved[axis] += h;
                sh::basis(moved)
            };
            let (ahead, behind) = (step(1e-6), step(-1e-6));
            for n in 0..16 {
                let difference = (ahead[n] - behind[n]) / 2e-6;
                assert!((slopes[n][axis] - difference).abs() < 1e-8, "coefficient {n} axis {axis}");
            }
        }
    }

    #[test]
    fn a_clamped_channel_passes_no_gradient() {
        let mut grads = [[9.0; 3]];
        let coefficients = [[-3.0, 1.0, 0.0]];
        assert_eq!(colour(&coefficients, DVec3::Z).map(|c| c[0]), Some(0.0));
        colour_grad(&coefficients, DVec3::Z, [1.0; 3], &mut grads);
        assert_eq!(grads[0][0], 0.0);
        assert!(grads[0][1] > 0.0);
    }
}
