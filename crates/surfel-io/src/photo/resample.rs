//! Resizing with the right blur: every output pixel is the mean of the input area it covers.
//!
//! Shrinking by area is what keeps texture from aliasing, and with continuous coordinates
//! (`x' = x w'/w`) it is exactly the change of intrinsics that `Camera::resized` makes. Enlarging
//! interpolates linearly. Invariant: a constant image stays constant.

use rayon::prelude::*;

/// Interleaved pixels of 8 or 16 bits.
pub(super) enum Pixels {
    /// Values 0..=255.
    Bits8(Vec<u8>),
    /// Values 0..=65535.
    Bits16(Vec<u16>),
}

/// An image as decoded.
pub(super) struct Raster {
    pub width: usize,
    pub height: usize,
    pub channels: usize,
    pub pixels: Pixels,
}

/// An image of values in \[0, 1\], interleaved.
pub(super) struct FloatRaster {
    pub width: usize,
    pub height: usize,
    pub channels: usize,
    pub values: Vec<f32>,
}

impl Raster {
    /// Resampled to `width` x `height`, both at least 1.
    pub fn resized(&self, width: usize, height: usize) -> FloatRaster {
        let size = (self.width, self.height);
        let values = match &self.pixels {
            Pixels::Bits8(pixels) => resize(pixels, self.channels, size, (width, height), 1.0 / 255.0),
            Pixels::Bits16(pixels) => resize(pixels, self.channels, size, (width, height), 1.0 / 65535.0),
        };
        FloatRaster { width, height, channels: self.channels, values }
    }
}

impl FloatRaster {
    /// Bilinear sample at continuous coordinates, edges repeated.
    pub fn sample(&self, x: f64, y: f64, out: &mut [f32]) {
        let split = |c: f64, length: usize| {
            let index = (c - 0.5).clamp(0.0, (length - 1) as f64);
            let low = (index as usize).min(length - 1);
            (low, (low + 1).min(length - 1), (index - low as f64) as f32)
        };
        let ((x0, x1, fx), (y0, y1, fy)) = (split(x, self.width), split(y, self.height));
        let at = |x: usize, y: usize, c: usize| self.values[(y * self.width + x) * self.channels + c];
        for (c, out) in out.iter_mut().enumerate() {
            let top = at(x0, y0, c) * (1.0 - fx) + at(x1, y0, c) * fx;
            let bottom = at(x0, y1, c) * (1.0 - fx) + at(x1, y1, c) * fx;
            *out = top * (1.0 - fy) + bottom * fy;
        }
    }
}

/// Input samples `start..` and their weights (sum 1) for one output sample.
struct Tap {
    start: usize,
    weights: Vec<f32>,
}

fn taps(input: usize, output: usize) -> Vec<Tap> {
    let step = input as f64 / output as f64;
    (0..output)
        .map(|index| if step > 1.0 { area_tap(index, step, input) } else { linear_tap(index, step, input) })
        .collect()
}

fn area_tap(index: usize, step: f64, input: usize) -> Tap {
    let (from, to) = (index as f64 * step, ((index + 1) as f64 * step).min(input as f64));
    let start = (from as usize).min(input - 1);
    let end = (to.ceil() as usize).clamp(start + 1, input);
    let covered = |sample: usize| ((sample + 1) as f64).min(to) - (sample as f64).max(from);
    let total: f64 = (start..end).map(covered).sum();
    Tap { start, weights: (start..end).map(|sample| (covered(sample) / total) as f32).collect() }
}

fn linear_tap(index: usize, step: f64, input: usize) -> Tap {
    let centre = ((index as f64 + 0.5) * step - 0.5).clamp(0.0, (input - 1) as f64);
    let start = (centre as usize).min(input.saturating_sub(2));
    let fraction = (centre - start as f64) as f32;
    let weights = if input == 1 { vec![1.0] } else { vec![1.0 - fraction, fraction] };
    Tap { start, weights }
}

/// Rows first: each output row needs few input rows, so nothing of the input's size is ever copied.
pub(super) fn resize<T: Copy + Sync + Into<f32>>(
    pixels: &[T],
    channels: usize,
    (width, height): (usize, usize),
    (new_width, new_height): (usize, usize),
    scale: f32,
) -> Vec<f32> {
    let (columns, rows) = (taps(width, new_width), taps(height, new_height));
    let mut values = vec![0.0f32; new_width * new_height * channels];
    values.par_chunks_exact_mut(new_width * channels).zip(&rows).for_each_init(
        || vec![0.0f32; width * channels],
        |blended, (out, row)| {
            blended.fill(0.0);
            for (offset, &weight) in row.weights.iter().enumerate() {
                let input = &pixels[(row.start + offset) * width * channels..][..width * channels];
                blended.iter_mut().zip(input).for_each(|(sum, &value)| *sum += weight * value.into());
            }
            for (out, column) in out.chunks_exact_mut(channels).zip(&columns) {
                for (offset, &weight) in column.weights.iter().enumerate() {
                    let input = &blended[(column.start + offset) * channels..][..channels];
                    out.iter_mut().zip(input).for_each(|(sum, &value)| *sum += weight * value);
                }
                out.iter_mut().for_each(|value| *value *= scale);
            }
        },
    );
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The same thing said plainly: integrate the piecewise constant image over each output pixel.
    fn slow_area(pixels: &[u8], (w, h): (usize, usize), (nw, nh): (usize, usize)) -> Vec<f32> {
        let overlap = |a0: f64, a1: f64, i: usize| (a1.min(i as f64 + 1.0) - a0.max(i as f64)).max(0.0);
        let mut out = Vec::new();
        for y in 0..nh {
            for x in 0..nw {
                let (sx, sy) = (w as f64 / nw as f64, h as f64 / nh as f64);
                let mut sum = 0.0;
                for v in 0..h {
                    for u in 0..w {
                        let area = overlap(x as f64 * sx, (x + 1) as f64 * sx, u)
                            * overlap(y as f64 * sy, (y + 1) as f64 * sy, v);
                        sum += area * f64::from(pixels[v * w + u]);
                    }
                }
                out.push((sum / (sx * sy) / 255.0) as f32);
            }
        }
        out
    }

    proptest! {
        #[test]
        fn shrinking_is_the_mean_over_the_covered_area(
            (w, h) in (1usize..24, 1usize..24), shrink_x in 1usize..24, shrink_y in 1usize..24, seed in any::<u32>(),
        ) {
            let (nw, nh) = (shrink_x.min(w), shrink_y.min(h));
            let pixels: Vec<u8> = (0..w * h).map(|i| ((i as u32).wrapping_mul(2_654_435_761).wrapping_add(seed) >> 13) as u8).collect();
            let fast = resize(&pixels, 1, (w, h), (nw, nh), 1.0 / 255.0);
            for (a, b) in fast.iter().zip(slow_area(&pixels, (w, h), (nw, nh))) {
                prop_assert!((a - b).abs() < 1e-5);
            }
        }

        #[test]
        fn a_constant_stays_constant_at_any_size(w in 1usize..40, h in 1usize..40, nw in 1usize..60, nh in 1usize..60) {
            let values = resize(&vec![200u8; w * h * 3], 3, (w, h), (nw, nh), 1.0 / 255.0);
            prop_assert_eq!(values.len(), nw * nh * 3);
            prop_assert!(values.iter().all(|v| (v - 200.0 / 255.0).abs() < 1e-5));
        }
    }

    #[test]
    fn a_ramp_keeps_its_place_in_continuous_coordinates() {
        let ramp: Vec<u8> = (0..100).collect();
        for new_width in [25usize, 40, 50, 100, 200] {
            let out = resize(&ramp, 1, (100, 1), (new_width, 1), 1.0);
            for (index, value) in out.iter().enumerate().skip(2).take(new_width - 4) {
                let expected = (index as f32 + 0.5) * 100.0 / new_width as f32 - 0.5;
                // Steps inside an output pixel that is no whole number of input pixels wide cost a little.
                assert!((value - expected).abs() < 0.1, "{new_width}: {value} != {expected}");
            }
        }
    }
}
