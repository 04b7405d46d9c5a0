//! Lens distortion: where a ray really lands on the sensor, for every COLMAP and OpenCV perspective model.
//!
//! Everything is in *normalised* image coordinates (`x / z`, `y / z`; no focal length), so a lens never
//! changes when a photograph is resized. Readers attach a [`Lens`] to a photograph and the loader removes
//! it; the rest of the pipeline sees pinholes only. Invariant: `undistort` returns a point only if
//! `distort` leads back to it.

use glam::{DMat2, DVec2};
use std::f64::consts::FRAC_PI_2;

/// How a lens bends rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// A pinhole (`SIMPLE_PINHOLE`, `PINHOLE`).
    None,
    /// The polynomial acts on `(x/z, y/z)` (`SIMPLE_RADIAL`, `RADIAL`, `OPENCV`, `FULL_OPENCV`).
    Perspective(Polynomial),
    /// The polynomial acts on the point at distance `atan(r)` from the centre (`OPENCV_FISHEYE`,
    /// `SIMPLE_RADIAL_FISHEYE`, `RADIAL_FISHEYE`, `THIN_PRISM_FISHEYE`).
    Fisheye(Polynomial),
    /// Devernay and Faugeras' field-of-view model (`FOV`).
    Fov {
        /// The model's angle, radians.
        omega: f64,
    },
}

/// `p -> p (1 + Σ n_i r^2i) / (1 + Σ d_i r^2i) + tangential + prism`, with `r = |p|`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Polynomial {
    /// Coefficients of r², r⁴, r⁶, r⁸ above the line.
    pub numerator: [f64; 4],
    /// Coefficients of r², r⁴, r⁶ below the line (OpenCV's k4, k5, k6).
    pub denominator: [f64; 3],
    /// Decentring `[p1, p2]`.
    pub tangential: [f64; 2],
    /// Thin prism `[sx1, sy1]`.
    pub prism: [f64; 2],
}

impl Polynomial {
    /// Purely radial, coefficients of r², r⁴, ... (at most four).
    pub fn radial(coefficients: &[f64]) -> Self {
        let mut numerator = [0.0; 4];
        numerator.iter_mut().zip(coefficients).for_each(|(n, &c)| *n = c);
        Self { numerator, ..Self::default() }
    }

    /// OpenCV's order: `k1 k2 p1 p2 [k3 [k4 k5 k6]]`; missing ones are zero.
    pub fn opencv(coefficients: &[f64]) -> Self {
        let k = |i: usize| coefficients.get(i).copied().unwrap_or(0.0);
        Self {
            numerator: [k(0), k(1), k(4), 0.0],
            denominator: [k(5), k(6), k(7)],
            tangential: [k(2), k(3)],
            prism: [0.0; 2],
        }
    }

    fn is_identity(&self) -> bool {
        *self == Self::default()
    }

    fn apply(&self, p: DVec2) -> DVec2 {
        let r_sq = p.length_squared();
        let ([p1, p2], xy) = (self.tangential, p.x * p.y);
        let tangential =
            DVec2::new(2.0 * p1 * xy + p2 * (r_sq + 2.0 * p.x * p.x), 2.0 * p2 * xy + p1 * (r_sq + 2.0 * p.y * p.y));
        p * self.radial_factor(r_sq) + tangential + DVec2::from_array(self.prism) * r_sq
    }

    fn radial_factor(&self, r_sq: f64) -> f64 {
        let horner = |c: &[f64]| 1.0 + r_sq * c.iter().rev().fold(0.0, |sum, &k| sum * r_sq + k);
        horner(&self.numerator) / horner(&self.denominator)
    }

    /// The radius up to which the radial part grows; `limit` when it grows all the way.
    ///
    /// Scanned rather than solved: a fold narrower than 1/4000 of the range would be missed, and no
    /// calibrated lens has one.
    fn monotonic_radius(&self, limit: f64) -> f64 {
        const STEPS: usize = 4000;
        let mut previous = 0.0;
        for i in 1..=STEPS {
            let r = limit * i as f64 / STEPS as f64;
            let image = r * self.radial_factor(r * r);
            // A NaN behind a pole must stop the scan too.
            if image.is_nan() || image <= previous {
                return limit * (i - 1) as f64 / STEPS as f64;
            }
            previous = image;
        }
        limit
    }

    /// The point within `limit` of the centre that `apply` sends to `image`.
    fn invert(&self, image: DVec2, limit: f64) -> Option<DVec2> {
        let mut p = self.radial_guess(image, self.monotonic_radius(limit))?;
        for _ in 0..50 {
            let residual = self.apply(p) - image;
            if residual.length() <= 1e-13 * (1.0 + image.length()) {
                break;
            }
            let step = self.jacobian(p).inverse() * residual;
            if !step.is_finite() {
                return None;
            }
            p -= step;
        }
        let converged = (self.apply(p) - image).length() <= 1e-9 * (1.0 + image.length());
        // A negative determinant means Newton jumped over the fold.
        (converged && p.length() <= limit && self.jacobian(p).determinant() > 0.0).then_some(p)
    }

    /// Bisection of the radial part on its growing branch; the start that keeps Newton on that branch.
    fn radial_guess(&self, image: DVec2, monotonic: f64) -> Option<DVec2> {
        let target = image.length();
        if target == 0.0 {
            return Some(DVec2::ZERO);
        }
        let radial = |r: f64| r * self.radial_factor(r * r);
        // The tangential terms may carry a point just beyond the radial limit; Newton decides there.
        let reach = radial(monotonic) * 1.02 + 1e-9;
        if target.is_nan() || reach.is_nan() || target > reach {
            return None;
        }
        let (mut low, mut high) = (0.0, monotonic);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if radial(middle) < target { low = middle } else { high = middle }
        }
        // Slightly inside, where the slope is not yet zero.
        Some(image * (0.5 * (low + high) / target).min(0.999 * monotonic / target))
    }

    fn jacobian(&self, p: DVec2) -> DMat2 {
        let h = 1e-6 * (1.0 + p.length());
        let along = |axis: DVec2| (self.apply(p + axis * h) - self.apply(p - axis * h)) / (2.0 * h);
        DMat2::from_cols(along(DVec2::X), along(DVec2::Y))
    }
}

/// Rays further than this from the optical axis have no use in a pinhole image: tan(89.4°).
const MAX_RADIUS: f64 = 100.0;

impl Lens {
    /// Perspective distortion, or [`Lens::None`] when every coefficient is zero.
    pub fn perspective(polynomial: Polynomial) -> Self {
        if polynomial.is_identity() { Self::None } else { Self::Perspective(polynomial) }
    }

    /// True for a pinhole.
    pub fn is_none(&self) -> bool {
        matches!(self, Self::None)
    }

    /// Normalised pinhole point to normalised point on the sensor.
    ///
    /// Meaningful up to [`Self::radius_of_validity`]; beyond, a polynomial folds the picture back.
    pub fn distort(&self, pinhole: DVec2) -> DVec2 {
        let r = pinhole.length();
        match self {
            Self::None => pinhole,
            Self::Perspective(polynomial) => polynomial.apply(pinhole),
            Self::Fisheye(polynomial) if r < 1e-12 => polynomial.apply(pinhole),
            Self::Fisheye(polynomial) => polynomial.apply(pinhole * (r.atan() / r)),
            Self::Fov { omega } if omega.abs() < 1e-9 || r < 1e-12 => pinhole * fov_centre(*omega),
            Self::Fov { omega } => pinhole * ((2.0 * r * (0.5 * omega).tan()).atan() / (omega * r)),
        }
    }

    /// Normalised sensor point to normalised pinhole point.
    ///
    /// `None` where the sensor point has no preimage: beyond the fold of a polynomial, or 90° and more
    /// off the axis of a fisheye.
    pub fn undistort(&self, sensor: DVec2) -> Option<DVec2> {
        match self {
            Self::None => Some(sensor),
            Self::Perspective(polynomial) => polynomial.invert(sensor, MAX_RADIUS),
            Self::Fisheye(polynomial) => {
                let p = polynomial.invert(sensor, FRAC_PI_2)?;
                let angle = p.length();
                match angle {
                    _ if angle < 1e-12 => Some(p),
                    _ if angle.tan() > MAX_RADIUS || angle >= FRAC_PI_2 => None,
                    _ => Some(p * (angle.tan() / angle)),
                }
            }
            Self::Fov { omega } => {
                let r = sensor.length();
                if omega.abs() < 1e-9 || r < 1e-12 {
                    return Some(sensor / fov_centre(*omega));
                }
                let angle = r * omega;
                (angle.abs() < MAX_RADIUS.atan()).then(|| sensor * (angle.tan() / (2.0 * (0.5 * omega).tan() * r)))
            }
        }
    }

    /// The pinhole radius (`tan` of the angle off the axis) up to which `distort` is one-to-one.
    ///
    /// Infinite for models that never fold. Not cheap: compute it once per image.
    pub fn radius_of_validity(&self) -> f64 {
        let of = |monotonic: f64, limit: f64| if monotonic >= limit { f64::INFINITY } else { monotonic };
        match self {
            Self::None | Self::Fov { .. } => f64::INFINITY,
            Self::Perspective(polynomial) => of(polynomial.monotonic_radius(MAX_RADIUS), MAX_RADIUS),
            Self::Fisheye(polynomial) => of(polynomial.monotonic_radius(FRAC_PI_2).tan(), FRAC_PI_2.tan()),
        }
    }
}

/// The magnification of the FOV model at the centre of the image.
fn fov_centre(omega: f64) -> f64 {
    if omega.abs() < 1e-9 { 1.0 } else { 2.0 * (0.5 * omega).tan() / omega }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lenses() -> Vec<Lens> {
        vec![
            Lens::None,
            Lens::perspective(Polynomial::radial(&[-0.1])),
            Lens::perspective(Polynomial::radial(&[-0.25, 0.08])),
            Lens::perspective(Polynomial::opencv(&[0.0578421, -0.0805099, -0.000980296, 0.00015575])),
            Lens::perspective(Polynomial::opencv(&[0.4, -0.3, 0.001, -0.002, 0.05, 0.6, -0.2, 0.1])),
            Lens::Fisheye(Polynomial::radial(&[-0.02, 0.004, -0.001, 0.0002])),
            Lens::Fisheye(Polynomial::radial(&[-0.05])),
            Lens::Fisheye(Polynomial {
                tangential: [0.001, -0.0007],
                prism: [0.0005, 0.0003],
                ..Polynomial::radial(&[-0.03, 0.002])
            }),
            Lens::Fov { omega: 0.9 },
            Lens::Fov { omega: 0.0 },
        ]
    }

    fn disc(radius: f64) -> impl Iterator<Item = DVec2> {
        (0..200).map(move |i| DVec2::from_angle(2.4 * f64::from(i)) * radius * (f64::from(i) / 199.0))
    }

    #[test]
    fn undistort_inverts_distort_inside_the_radius_of_validity() {
        for lens in lenses() {
            let radius = (0.9 * lens.radius_of_validity()).min(1.2);
            for p in disc(radius) {
                let back = lens.undistort(lens.distort(p)).unwrap_or_else(|| panic!("{lens:?} lost {p}"));
                assert!((back - p).length() < 1e-9, "{lens:?}: {p} came back as {back}");
            }
        }
    }

    #[test]
    fn a_folding_polynomial_is_refused_beyond_its_fold() {
        // r (1 - r² / 3) grows up to r = 1, where it reaches 2/3.
        let lens = Lens::perspective(Polynomial::radial(&[-1.0 / 3.0]));
        assert!((lens.radius_of_validity() - 1.0).abs() < 0.05);
        assert!(lens.undistort(DVec2::new(0.6, 0.0)).is_some());
        assert_eq!(lens.undistort(DVec2::new(0.75, 0.0)), None);
        assert_eq!(Lens::Fov { omega: 1.0 }.radius_of_validity(), f64::INFINITY);
    }

    #[test]
    fn a_fisheye_without_coefficients_is_equidistant() {
        let lens = Lens::Fisheye(Polynomial::default());
        let half_right_angle = std::f64::consts::FRAC_PI_4;
        assert!((lens.distort(DVec2::X) - DVec2::X * half_right_angle).length() < 1e-15);
        assert_eq!(lens.undistort(DVec2::X * 1.6), None);
    }

    /// Values of `cv2.projectPoints` / `cv2.fisheye.distortPoints` for the point (0.3, -0.2).
    #[test]
    fn coefficients_mean_what_opencv_means() {
        let p = DVec2::new(0.3, -0.2);
        let brown = Lens::perspective(Polynomial::opencv(&[0.1, -0.2, 0.01, -0.02, 0.05, 0.3, 0.02, -0.1]));
        let fisheye = Lens::Fisheye(Polynomial::radial(&[0.1, -0.2, 0.05, 0.02]));
        assert!((brown.distort(p) - OPENCV_BROWN).length() < 1e-12, "{}", brown.distort(p));
        assert!((fisheye.distort(p) - OPENCV_FISHEYE).length() < 1e-12, "{}", fisheye.distort(p));
    }

    const OPENCV_BROWN: DVec2 = DVec2::new(0.2841153693280159, -0.18984357955201062);
    const OPENCV_FISHEYE: DVec2 = DVec2::new(0.2905764937114407, -0.1937176624742938);
}
