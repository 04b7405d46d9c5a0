//! Depthwise convolution of one output row on pixel-major maps.
//!
//! Invariant: the caller has padded the rows, so that no tap needs a test.

use crate::pointwise::Activation;
use pulp::Simd;

/// The number of channels is a multiple of this, and this of every machine's vector length.
const GROUP: usize = 16;

/// One filter per channel, followed by ReLU6.
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
        assert!(channels.is_multiple_of(GROUP) && weights.len() == channels * kernel * kernel);
        let area = kernel * kernel;
        let taps = (0..area * channels).map(|i| weights[i % channels * area + i / channels]).collect();
        Self { channels, kernel, stride, taps, bias }
    }

    /// One output row from the `kernel` padded input rows it covers, top first.
    #[inline(always)]
    pub(crate) fn row<S: Simd>(&self, simd: S, rows: &[&[f32]], output: &mut [f32]) {
        let num_vectors = self.channels / S::F32_LANES;
        let (taps, bias) = (S::as_simd_f32s(&self.taps).0, S::as_simd_f32s(&self.bias).0);
        for (x, pixel) in output.chunks_exact_mut(self.channels).enumerate() {
            let first = x * self.stride * self.channels;
            let pixel = S::as_mut_simd_f32s(pixel).0;
            pixel.copy_from_slice(bias);
            for (dy, row) in rows.iter().enumerate() {
                let values = S::as_simd_f32s(&row[first..][..self.kernel * self.channels]).0;
                let taps = &taps[dy * self.kernel * num_vectors..][..self.kernel * num_vectors];
                for (v, sum) in pixel.iter_mut().enumerate() {
                    for dx in 0..self.kernel {
                        let i = dx * num_vectors + v;
                        *sum = simd.mul_add_e_f32s(values[i], taps[i], *sum);
                    }
                }
            }
            for sum in pixel {
                *sum = Activation::Relu6.apply(simd, *sum);
            }
        }
    }
}
