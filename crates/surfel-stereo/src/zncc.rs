//! Zero-mean normalised cross-correlation of two images over a square window.
//!
//! The photometric half of the sweep's matching cost; blind to gain and offset between the photographs.
//! Invariant: the running-sum implementation equals the direct one (in the tests) to rounding.

/// Variance of a flat window of an 8-bit photograph: windows that vary less carry no evidence, and their
/// correlation fades to zero.
pub const VARIANCE_FLOOR: f32 = 4e-5;

/// Column sums of `a, b, a², b², ab` over the rows of the current window.
#[derive(Default)]
pub struct ZnccBand {
    columns: [Vec<f32>; 5],
}

impl ZnccBand {
    /// Scores a band of `rows` rows of `width` pixels.
    ///
    /// Writes one value in \[-1, 1\] for each pixel of the rows `radius..rows - radius` into `out`
    /// (`width * (rows - 2 radius)` values). Windows are clipped at the left and right edge.
    pub fn score(&mut self, a: &[f32], b: &[f32], width: usize, rows: usize, radius: usize, out: &mut [f32]) {
        debug_assert!(rows > 2 * radius && out.len() == width * (rows - 2 * radius));
        for sums in &mut self.columns {
            sums.clear();
            sums.resize(width, 0.0);
        }
        let row = |grid: &'_ [f32], y: usize| -> std::ops::Range<usize> {
            debug_assert!(grid.len() >= (y + 1) * width);
            y * width..(y + 1) * width
        };
        for y in 0..2 * radius {
            self.add(&a[row(a, y)], &b[row(b, y)], 1.0);
        }
        for y in 0..rows - 2 * radius {
            let entering = y + 2 * radius;
            self.add(&a[row(a, entering)], &b[row(b, entering)], 1.0);
            self.correlate(radius, &mut out[y * width..][..width]);
            self.add(&a[row(a, y)], &b[row(b, y)], -1.0);
        }
    }

    fn add(&mut self, a: &[f32], b: &[f32], sign: f32) {
        let [sa, sb, saa, sbb, sab] = &mut self.columns;
        let sums = sa.iter_mut().zip(sb).zip(saa).zip(sbb).zip(sab);
        for (((((sa, sb), saa), sbb), sab), (&a, &b)) in sums.zip(a.iter().zip(b)) {
            *sa += sign * a;
            *sb += sign * b;
            *saa += sign * a * a;
            *sbb += sign * b * b;
            *sab += sign * a * b;
        }
    }

    /// Slides the window along the row of column sums.
    fn correlate(&self, radius: usize, out: &mut [f32]) {
        let width = out.len();
        let columns = &self.columns;
        let mut sums = [0.0f32; 5];
        let window_rows = (2 * radius + 1) as f32;
        for x in 0..radius.min(width) {
            for (sum, column) in sums.iter_mut().zip(columns) {
                *sum += column[x];
            }
        }
        for x in 0..width {
            if x + radius < width {
                for (sum, column) in sums.iter_mut().zip(columns) {
                    *sum += column[x + radius];
                }
            }
            let (left, right) = (x.saturating_sub(radius), (x + radius).min(width - 1));
            let inverse = 1.0 / (window_rows * (right - left + 1) as f32);
            let (mean_a, mean_b) = (sums[0] * inverse, sums[1] * inverse);
            let var_a = (sums[2] * inverse - mean_a * mean_a).max(0.0) + VARIANCE_FLOOR;
            let var_b = (sums[3] * inverse - mean_b * mean_b).max(0.0) + VARIANCE_FLOOR;
            let covariance = sums[4] * inverse - mean_a * mean_b;
            out[x] = (covariance / (var_a * var_b).sqrt()).clamp(-1.0, 1.0);
            if x >= radius {
                for (sum, column) in sums.iter_mut().zip(columns) {
                    *sum -= column[x - radius];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn zncc_direct(a: &[f32], b: &[f32], width: usize, x: usize, y: usize, radius: usize) -> f32 {
        let mut pairs = Vec::new();
        for yy in y - radius..=y + radius {
            for xx in x.saturating_sub(radius)..=(x + radius).min(width - 1) {
                pairs.push((f64::from(a[yy * width + xx]), f64::from(b[yy * width + xx])));
            }
        }
        let n = pairs.len() as f64;
        let (ma, mb) = (pairs.iter().map(|p| p.0).sum::<f64>() / n, pairs.iter().map(|p| p.1).sum::<f64>() / n);
        let mean = |f: &dyn Fn(f64, f64) -> f64| pairs.iter().map(|&(a, b)| f(a - ma, b - mb)).sum::<f64>() / n;
        let floor = f64::from(VARIANCE_FLOOR);
        (mean(&|a, b| a * b) / ((mean(&|a, _| a * a) + floor) * (mean(&|_, b| b * b) + floor)).sqrt()) as f32
    }

    #[test]
    fn running_sums_equal_the_direct_correlation() {
        let (width, rows, radius) = (23, 17, 2);
        let noise = |seed: usize| -> Vec<f32> {
            (0..width * rows).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f32 / 1009.0).collect()
        };
        let (a, b) = (noise(1), noise(2));
        let mut out = vec![0.0; width * (rows - 2 * radius)];
        ZnccBand::default().score(&a, &b, width, rows, radius, &mut out);
        for y in radius..rows - radius {
            for x in 0..width {
                let expected = zncc_direct(&a, &b, width, x, y, radius);
                assert!((out[(y - radius) * width + x] - expected).abs() < 2e-4);
            }
        }
    }

    #[test]
    fn gain_and_offset_do_not_matter() {
        let a: Vec<f32> = (0..49).map(|i| ((i * 13) % 17) as f32 / 17.0).collect();
        let b: Vec<f32> = a.iter().map(|v| 0.3 * v + 0.4).collect();
        let mut out = vec![0.0; 7];
        ZnccBand::default().score(&a, &b, 7, 7, 3, &mut out);
        assert!(out[3] > 0.99);
    }
}
