//! Structural similarity of two pictures (spec 7.4).
//!
//! Gaussian window of sigma 1.5 over 11 x 11 pixels, sample covariance, K1 = 0.01, K2 = 0.03, data range 1, the 5
//! border pixels left out, mean over channels: what scikit-image computes with `gaussian_weights=True`.

use rayon::prelude::*;
use surfel_core::Grid;

const RADIUS: usize = 5;
const SIDE: usize = 2 * RADIUS + 1;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;
/// `NP / (NP - 1)` for the 121 pixels of the window: sample instead of population covariance.
const SAMPLE: f64 = (SIDE * SIDE) as f64 / (SIDE * SIDE - 1) as f64;

/// Mean SSIM, at most 1; NaN for pictures smaller than the window. Values are taken as they are, range \[0, 1\].
///
/// # Panics
/// If the pictures differ in size.
pub fn ssim(picture: &Grid<[f32; 3]>, reference: &Grid<[f32; 3]>) -> f64 {
    assert!(picture.same_size(reference), "pictures differ in size");
    let (width, height) = (picture.width(), picture.height());
    if width < SIDE || height < SIDE {
        return f64::NAN;
    }
    let weights = window();
    let (inner_w, inner_h) = (width - 2 * RADIUS, height - 2 * RADIUS);
    let rows: Vec<f64> = (0..inner_h)
        .into_par_iter()
        .map(|y| (0..3).map(|channel| row_sum(picture, reference, channel, y, inner_w, &weights)).sum())
        .collect();
    rows.iter().sum::<f64>() / (3 * inner_w * inner_h) as f64
}

/// Sum of SSIM over the row of windows whose top pixel row is `y`.
fn row_sum(a: &Grid<[f32; 3]>, b: &Grid<[f32; 3]>, channel: usize, y: usize, inner_w: usize, weights: &[f64]) -> f64 {
    // Down the columns first: five moments per column, then one pass along the row.
    let mut columns = vec![[0.0f64; 5]; a.width()];
    for (dy, &weight) in weights.iter().enumerate() {
        for ((column, p), q) in columns.iter_mut().zip(a.row(y + dy)).zip(b.row(y + dy)) {
            let (p, q) = (f64::from(p[channel]), f64::from(q[channel]));
            for (sum, value) in column.iter_mut().zip([p, q, p * p, q * q, p * q]) {
                *sum += weight * value;
            }
        }
    }
    let moments = |x: usize| {
        let mut sums = [0.0f64; 5];
        for (&weight, column) in weights.iter().zip(&columns[x..]) {
            for (sum, value) in sums.iter_mut().zip(column) {
                *sum += weight * value;
            }
        }
        sums
    };
    (0..inner_w).map(|x| from_moments(moments(x))).sum()
}

/// SSIM of one window from the weighted means of `p, q, p², q², pq`.
fn from_moments([mean_p, mean_q, pp, qq, pq]: [f64; 5]) -> f64 {
    let var_p = SAMPLE * (pp - mean_p * mean_p);
    let var_q = SAMPLE * (qq - mean_q * mean_q);
    let cov = SAMPLE * (pq - mean_p * mean_q);
    (2.0 * mean_p * mean_q + C1) * (2.0 * cov + C2) / ((mean_p * mean_p + mean_q * mean_q + C1) * (var_p + var_q + C2))
}

/// The normalised 1-D Gaussian.
fn window() -> [f64; SIDE] {
    let raw: [f64; SIDE] = std::array::from_fn(|i| {
        let d = i as f64 - RADIUS as f64;
        (-d * d / (2.0 * SIGMA * SIGMA)).exp()
    });
    let sum: f64 = raw.iter().sum();
    raw.map(|w| w / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(width: usize, height: usize, phase: f64) -> Grid<[f32; 3]> {
        Grid::from_fn(width, height, |x, y| {
            let wave = |a: f64, b: f64| (0.5 + 0.4 * (a * x as f64 + b * y as f64 + phase).sin()) as f32;
            [wave(0.3, 0.1), wave(-0.2, 0.5), wave(0.9, 0.4)]
        })
    }

    /// One window at a time with the full two-dimensional weights, means first, then centred moments.
    fn brute(a: &Grid<[f32; 3]>, b: &Grid<[f32; 3]>) -> f64 {
        let w = window();
        let (mut sum, mut count) = (0.0, 0usize);
        for channel in 0..3 {
            for y in 0..a.height() - 2 * RADIUS {
                for x in 0..a.width() - 2 * RADIUS {
                    let weighted = |value: &dyn Fn(f64, f64) -> f64| -> f64 {
                        (0..SIDE * SIDE)
                            .map(|i| {
                                let at = (x + i % SIDE, y + i / SIDE);
                                let (p, q) = (f64::from(a[at][channel]), f64::from(b[at][channel]));
                                w[i % SIDE] * w[i / SIDE] * value(p, q)
                            })
                            .sum()
                    };
                    let (mp, mq) = (weighted(&|p, _| p), weighted(&|_, q| q));
                    let var_p = 121.0 / 120.0 * weighted(&|p, _| (p - mp) * (p - mp));
                    let var_q = 121.0 / 120.0 * weighted(&|_, q| (q - mq) * (q - mq));
                    let cov = 121.0 / 120.0 * weighted(&|p, q| (p - mp) * (q - mq));
                    sum += (2.0 * mp * mq + C1) * (2.0 * cov + C2) / ((mp * mp + mq * mq + C1) * (var_p + var_q + C2));
                    count += 1;
                }
            }
        }
        sum / count as f64
    }

    #[test]
    fn separable_sums_equal_the_window_by_window_ones() {
        let (a, b) = (wave(23, 17, 0.0), wave(23, 17, 0.8));
        assert!((ssim(&a, &b) - brute(&a, &b)).abs() < 1e-10);
    }

    #[test]
    fn value_of_an_independent_implementation() {
        // tests/fixtures/ssim_scipy.py prints it.
        let value = ssim(&wave(40, 30, 0.0), &wave(40, 30, 0.8));
        assert!((value - 0.585_750_590_303).abs() < 1e-6, "{value}");
    }

    #[test]
    fn equal_is_one_and_too_small_is_nan() {
        let a = wave(20, 20, 0.3);
        assert!((ssim(&a, &a) - 1.0).abs() < 1e-12);
        assert!(ssim(&wave(10, 30, 0.0), &wave(10, 30, 0.0)).is_nan());
    }
}
