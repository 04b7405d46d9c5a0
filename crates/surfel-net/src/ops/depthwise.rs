//! Depthwise convolution of one output row on pixel-major maps.
//!
//! Invariant: the caller has padded the rows, so that no tap needs a test.

use super::pointwise::Activation;
use super::simd::multiply_add;

/// Channels summed together in registers; every trunk width is a multiple of it.
const LANES: usize = 16;

/// One filter per channel.
#[derive(Clone, Debug)]
pub(crate) struct Depthwise {
    pub(crate) channels: usize,
    pub(crate) kernel: usize,
    pub(crate) stride: usize,
    /// `taps[(dy * kernel + dx) * channels + c]`.
    taps: Vec<f32>,
    bias: Vec<f32>,
}

impl Depthwise {
    /// From weights `[channels, 1, kernel, kernel]` row-major.
    pub(crate) fn new(weights: &[f32], bias: Vec<f32>, kernel: usize, stride: usize) -> Self {
        let channels = bias.len();
        assert!(channels % LANES == 0 && weights.len() == channels * kernel * kernel);
        let area = kernel * kernel;
        let taps = (0..area * channels)
            .map(|i| weights[i % channels * area + i / channels])
            .collect();
        Self {
            channels,
            kernel,
            stride,
            taps,
            bias,
        }
    }

    /// One output row from the `kernel` padded input rows it covers, top first, ReLU6 applied.
    #[inline(always)]
    pub(crate) fn row<const FUSED: bool>(&self, rows: &[&[f32]], output: &mut [f32]) {
        for (x, pixel) in output.chunks_exact_mut(self.channels).enumerate() {
            let first = x * self.stride * self.channels;
            for c in (0..self.channels).step_by(LANES) {
                let mut sums: [f32; LANES] =
                    self.bias[c..][..LANES].try_into().expect("whole lanes");
                for (dy, row) in rows.iter().enumerate() {
                    for dx in 0..self.kernel {
                        let values = &row[first + dx * self.channels + c..][..LANES];
                        let taps =
                            &self.taps[(dy * self.kernel + dx) * self.channels + c..][..LANES];
                        for j in 0..LANES {
                            sums[j] = multiply_add::<FUSED>(values[j], taps[j], sums[j]);
                        }
                    }
                }
                for (out, sum) in pixel[c..][..LANES].iter_mut().zip(sums) {
                    *out = Activation::Relu6.apply(sum);
                }
            }
        }
    }
}

#[inline(always)]
fn lanes(values: &[f32], start: usize) -> &[f32; LANES] {
    values[start..]
        .first_chunk()
        .expect("every width is a multiple of the lanes")
}
