//! 1x1 convolution on pixel-major maps: a matrix product with the weights packed into column panels.
//!
//! Invariant: each output value is summed over inputs in ascending order, whatever the block sizes.

use super::simd::multiply_add;

/// Columns of one panel: two AVX registers.
const PANEL: usize = 16;
/// Rows computed together; 6 x 16 sums fill the sixteen AVX registers with room for the operands.
const ROWS: usize = 6;

/// What happens to a sum before it is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Activation {
    /// Nothing.
    Linear,
    /// Clamped to \[0, 6\].
    Relu6,
}

impl Activation {
    #[inline(always)]
    pub(crate) fn apply(self, value: f32) -> f32 {
        match self {
            Self::Linear => value,
            Self::Relu6 => value.clamp(0.0, 6.0),
        }
    }
}

/// A linear map from `num_inputs` to `num_outputs` channels with bias.
#[derive(Clone, Debug)]
pub(crate) struct Pointwise {
    pub(crate) num_inputs: usize,
    pub(crate) num_outputs: usize,
    /// `panels[(p * num_inputs + k) * PANEL + j]` is the weight of input `k` for output `p * PANEL + j`.
    panels: Vec<f32>,
    /// Bias, zero-padded to whole panels.
    bias: Vec<f32>,
}

impl Pointwise {
    /// From weights `[num_outputs, num_inputs]` row-major and one bias per output.
    pub(crate) fn new(weights: &[f32], bias: &[f32], num_inputs: usize) -> Self {
        let num_outputs = bias.len();
        assert_eq!(weights.len(), num_inputs * num_outputs);
        let num_panels = num_outputs.div_ceil(PANEL);
        let mut panels = vec![0.0; num_panels * num_inputs * PANEL];
        for n in 0..num_outputs {
            for k in 0..num_inputs {
                panels[(n / PANEL * num_inputs + k) * PANEL + n % PANEL] =
                    weights[n * num_inputs + k];
            }
        }
        let mut padded_bias = bias.to_vec();
        padded_bias.resize(num_panels * PANEL, 0.0);
        Self {
            num_inputs,
            num_outputs,
            panels,
            bias: padded_bias,
        }
    }

    /// `output[i] = activation(W input[i] + bias)` for pixel-major `input` and `output`.
    #[inline(always)]
    pub(crate) fn apply<const FUSED: bool>(
        &self,
        input: &[f32],
        output: &mut [f32],
        activation: Activation,
    ) {
        let num_pixels = input.len() / self.num_inputs;
        for (p, panel) in self
            .panels
            .chunks_exact(self.num_inputs * PANEL)
            .enumerate()
        {
            let columns = p * PANEL..((p + 1) * PANEL).min(self.num_outputs);
            let bias: &[f32; PANEL] = self.bias[p * PANEL..][..PANEL]
                .try_into()
                .expect("whole panel");
            let mut pixel = 0;
            while pixel < num_pixels {
                let rows = ROWS.min(num_pixels - pixel);
                let block = &input[pixel * self.num_inputs..][..rows * self.num_inputs];
                let target = &mut output[pixel * self.num_outputs..][..rows * self.num_outputs];
                if rows == ROWS {
                    self.block::<FUSED, ROWS>(
                        block,
                        panel,
                        bias,
                        target,
                        columns.clone(),
                        activation,
                    );
                } else {
                    for (one, target) in block
                        .chunks_exact(self.num_inputs)
                        .zip(target.chunks_exact_mut(self.num_outputs))
                    {
                        self.block::<FUSED, 1>(
                            one,
                            panel,
                            bias,
                            target,
                            columns.clone(),
                            activation,
                        );
                    }
                }
                pixel += rows;
            }
        }
    }

    #[inline(always)]
    fn block<const FUSED: bool, const R: usize>(
        &self,
        input: &[f32],
        panel: &[f32],
        bias: &[f32; PANEL],
        output: &mut [f32],
        columns: std::ops::Range<usize>,
        activation: Activation,
    ) {
        let (panel, _) = panel.as_chunks::<PANEL>();
        let num_inputs = panel.len();
        let rows: [&[f32]; R] = std::array::from_fn(|r| &input[r * num_inputs..][..num_inputs]);
        let mut sums = [*bias; R];
        for (k, weights) in panel.iter().enumerate() {
            for r in 0..R {
                let value = rows[r][k];
                for j in 0..PANEL {
                    sums[r][j] = multiply_add::<FUSED>(value, weights[j], sums[r][j]);
                }
            }
        }
        for (r, sums) in sums.iter().enumerate() {
            let target = &mut output[r * self.num_outputs..][columns.clone()];
            for (out, &sum) in target.iter_mut().zip(sums) {
                *out = activation.apply(sum);
            }
        }
    }
}
