//! Zero-mean normalised cross-correlation of two images over a square window.
//!
//! The photometric half of the sweep's matching cost; blind to gain and offset between the photographs. What
//! depends on the reference alone is computed once, the rest are running sums of a vector of columns at a time.
//! Invariant: the running sums give the direct correlation (in the tests) to rounding. Rows are padded to whole
//! vectors (`vector::MAX_LANES`) with zeros.

use crate::vector::MAX_LANES;

/// Variance of a flat window of an 8-bit photograph: windows that vary less carry no evidence, and their
/// correlation fades to zero.
pub const VARIANCE_FLOOR: f32 = 4e-5;

/// The reference in square windows around its pixels, clipped at its left and right edge; rows beyond its upper
/// and lower edge repeat the border.
pub struct ReferenceWindows {
    /// Pixels on either side of the central one.
    pub radius: usize,
    /// 1 / number of pixels of the window, per column.
    inverse_count: Vec<f32>,
    /// Mean, `[height][padded width]`.
    mean: Vec<f32>,
    /// 1 / standard deviation, as `mean`.
    inverse_deviation: Vec<f32>,
}

impl ReferenceWindows {
    /// Windows of the rows `luma`, `[height][padded width]`, whose first `width` columns are the image.
    pub fn new(luma: &[f32], width: usize, radius: usize) -> Self {
        let padded = width.next_multiple_of(MAX_LANES);
        let height = luma.len() / padded;
        let side = (2 * radius + 1) as f32;
        let columns_at = |x: usize| (x + radius).min(width - 1) - x.saturating_sub(radius) + 1;
        let inverse_count: Vec<f32> =
            (0..padded).map(|x| if x < width { 1.0 / (side * columns_at(x) as f32) } else { 0.0 }).collect();
        let (mut mean, mut inverse_deviation) = (vec![0.0; luma.len()], vec![0.0; luma.len()]);
        let mut columns = vec![[0.0f32; 2]; padded + 2 * radius];
        for y in 0..height {
            columns[radius..][..width].fill([0.0; 2]);
            for dy in 0..=2 * radius {
                let row = &luma[(y + dy).saturating_sub(radius).min(height - 1) * padded..][..width];
                for (sums, a) in columns[radius..].iter_mut().zip(row) {
                    *sums = [sums[0] + a, sums[1] + a * a];
                }
            }
            for x in 0..width {
                let window = &columns[x..][..2 * radius + 1];
                let [sum, sum_sq] = window.iter().fold([0.0; 2], |s, column| [s[0] + column[0], s[1] + column[1]]);
                let average = sum * inverse_count[x];
                let variance = (sum_sq * inverse_count[x] - average * average).max(0.0) + VARIANCE_FLOOR;
                mean[y * padded + x] = average;
                inverse_deviation[y * padded + x] = 1.0 / variance.sqrt();
            }
        }
        Self { radius, inverse_count, mean, inverse_deviation }
    }
}

/// Per column, the sums of `b, b², ab` over the rows of the current windows; `radius` zero columns on either side.
///
/// Plain loops over whole rows: they become vectors of whatever the caller is compiled for.
#[derive(Default)]
pub struct ColumnSums {
    columns: [Vec<f32>; 3],
    windows: [Vec<f32>; 3],
    radius: usize,
}

impl ColumnSums {
    /// Starts over, without any row.
    pub fn clear(&mut self, padded_width: usize, radius: usize) {
        self.radius = radius;
        for sums in &mut self.columns {
            sums.clear();
            sums.resize(padded_width + 2 * radius, 0.0);
        }
        for sums in &mut self.windows {
            sums.resize(padded_width, 0.0);
        }
    }

    /// Adds a row of the reference `a` and the other image `b`.
    #[inline(always)]
    pub fn enter(&mut self, a: &[f32], b: &[f32]) {
        let [sum_b, sum_bb, sum_ab] = &mut self.columns;
        let sums = sum_b[self.radius..].iter_mut().zip(&mut sum_bb[self.radius..]).zip(&mut sum_ab[self.radius..]);
        for (((sum_b, sum_bb), sum_ab), (a, b)) in sums.zip(a.iter().zip(b)) {
            *sum_b += b;
            *sum_bb += b * b;
            *sum_ab += a * b;
        }
    }

    /// Takes away a row that had entered.
    #[inline(always)]
    pub fn leave(&mut self, a: &[f32], b: &[f32]) {
        let [sum_b, sum_bb, sum_ab] = &mut self.columns;
        let sums = sum_b[self.radius..].iter_mut().zip(&mut sum_bb[self.radius..]).zip(&mut sum_ab[self.radius..]);
        for (((sum_b, sum_bb), sum_ab), (a, b)) in sums.zip(a.iter().zip(b)) {
            *sum_b -= b;
            *sum_bb -= b * b;
            *sum_ab -= a * b;
        }
    }

    /// Subtracts `weight` times the correlation of every window around row `y` of the reference from `cost`.
    #[inline(always)]
    pub fn correlate(&mut self, reference: &ReferenceWindows, y: usize, weight: f32, cost: &mut [f32]) {
        for (columns, windows) in self.columns.iter().zip(&mut self.windows) {
            sums_of_neighbours(columns, self.radius, windows);
        }
        let padded = reference.inverse_count.len();
        let row = y * padded..(y + 1) * padded;
        let [b, bb, ab] = &self.windows;
        let sums = b.iter().zip(bb).zip(ab);
        let known = reference.mean[row.clone()].iter().zip(&reference.inverse_deviation[row]);
        let known = known.zip(&reference.inverse_count);
        for ((cost, ((b, bb), ab)), ((mean_a, inverse_deviation_a), inverse)) in cost.iter_mut().zip(sums).zip(known) {
            let mean_b = b * inverse;
            let variance = (bb * inverse - mean_b * mean_b).max(0.0) + VARIANCE_FLOOR;
            let covariance = ab * inverse - mean_a * mean_b;
            *cost -= weight * (covariance * inverse_deviation_a / variance.sqrt());
        }
    }
}

/// `sums[x] = columns[x] + ... + columns[x + 2 radius]`.
#[inline(always)]
fn sums_of_neighbours(columns: &[f32], radius: usize, sums: &mut [f32]) {
    /// With a number of columns that the compiler knows.
    #[inline(always)]
    fn of<const N: usize>(columns: &[f32], sums: &mut [f32]) {
        for (sum, window) in sums.iter_mut().zip(columns.array_windows::<N>()) {
            let mut total = window[0];
            for column in &window[1..] {
                total += column;
            }
            *sum = total;
        }
    }
    match radius {
        1 => of::<3>(columns, sums),
        2 => of::<5>(columns, sums),
        3 => of::<7>(columns, sums),
        _ => {
            sums.fill(0.0);
            for shift in 0..=2 * radius {
                sums.iter_mut().zip(&columns[shift..]).for_each(|(sum, column)| *sum += column);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::Arch;

    fn zncc_direct(a: &[f32], b: &[f32], width: usize, x: usize, y: usize, radius: usize) -> f32 {
        let mut pairs = Vec::new();
        let last = a.len() / width - 1;
        for dy in 0..=2 * radius {
            let yy = (y + dy).saturating_sub(radius).min(last);
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

    /// Correlations of a whole image, as the sweep computes them.
    struct Correlations<'a> {
        a: &'a [f32],
        b: &'a [f32],
        width: usize,
        radius: usize,
    }

    impl Correlations<'_> {
        #[inline(always)]
        fn all(self) -> Vec<f32> {
            let padded = self.width.next_multiple_of(MAX_LANES);
            let height = self.a.len() / self.width;
            let rows = |image: &[f32]| -> Vec<f32> {
                let mut rows = vec![0.0; height * padded];
                for (row, pixels) in rows.chunks_exact_mut(padded).zip(image.chunks_exact(self.width)) {
                    row[..self.width].copy_from_slice(pixels);
                }
                rows
            };
            let (a, b) = (rows(self.a), rows(self.b));
            let reference = ReferenceWindows::new(&a, self.width, self.radius);
            let row = |image: &'_ [f32], y: isize| -> Vec<f32> {
                image[y.clamp(0, height as isize - 1) as usize * padded..][..padded].to_vec()
            };
            let radius = self.radius as isize;
            let mut sums = ColumnSums::default();
            sums.clear(padded, self.radius);
            for y in -radius..radius {
                sums.enter(&row(&a, y), &row(&b, y));
            }
            let mut all = Vec::new();
            for y in 0..height as isize {
                sums.enter(&row(&a, y + radius), &row(&b, y + radius));
                let mut cost = vec![0.0; padded];
                sums.correlate(&reference, y as usize, -1.0, &mut cost);
                all.extend_from_slice(&cost[..self.width]);
                sums.leave(&row(&a, y - radius), &row(&b, y - radius));
            }
            all
        }
    }

    #[test]
    fn running_sums_equal_the_direct_correlation() {
        let (width, height) = (23, 17);
        let noise = |seed: usize| -> Vec<f32> {
            (0..width * height).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f32 / 1009.0 - 0.5).collect()
        };
        let (a, b) = (noise(1), noise(2));
        for radius in [1, 3, 4] {
            let fast = Arch::new().dispatch(|| Correlations { a: &a, b: &b, width, radius }.all());
            for y in 0..height {
                for x in 0..width {
                    let expected = zncc_direct(&a, &b, width, x, y, radius);
                    assert!((fast[y * width + x] - expected).abs() < 1e-4, "radius {radius} at {x},{y}");
                }
            }
        }
    }

    #[test]
    fn gain_and_offset_do_not_matter() {
        let a: Vec<f32> = (0..49).map(|i| ((i * 13) % 17) as f32 / 17.0).collect();
        let b: Vec<f32> = a.iter().map(|v| 0.3 * v + 0.4).collect();
        let correlations = Arch::new().dispatch(|| Correlations { a: &a, b: &b, width: 7, radius: 3 }.all());
        assert!(correlations[3 * 7 + 3] > 0.99);
    }
}
