//! 1x1 convolution on pixel-major maps: a matrix product with the weights packed into column panels.
//!
//! Invariant: each output value is summed over inputs in ascending order, whatever the block sizes.

use pulp::{Arch, Simd, WithSimd};

/// Vectors per panel.
const VECTORS: usize = 2;
/// Rows computed together: 6 x 2 sums fill the sixteen AVX registers with room for the operands.
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
    pub(crate) fn apply<S: Simd>(self, simd: S, value: S::f32s) -> S::f32s {
        match self {
            Self::Linear => value,
            Self::Relu6 => simd.min_f32s(simd.max_f32s(value, simd.splat_f32s(0.0)), simd.splat_f32s(6.0)),
        }
    }
}

/// A linear map from `num_inputs` to `num_outputs` channels with bias.
#[derive(Clone, Debug)]
pub(crate) struct Pointwise {
    pub(crate) num_inputs: usize,
    pub(crate) num_outputs: usize,
    /// Weight of input `k` for output `p * panel + j` at `(p * num_inputs + k) * panel + j`, where
    /// `panel` is `VECTORS` vectors of this machine.
    panels: Vec<f32>,
    /// Bias, zero-padded to whole panels.
    bias: Vec<f32>,
}

impl Pointwise {
    /// Weights, bias aside.
    pub(crate) fn num_weights(&self) -> u64 {
        (self.num_inputs * self.num_outputs) as u64
    }

    /// From weights `[num_outputs, num_inputs]` row-major and one bias per output.
    pub(crate) fn new(weights: &[f32], bias: &[f32], num_inputs: usize) -> Self {
        let num_outputs = bias.len();
        assert_eq!(weights.len(), num_inputs * num_outputs);
        let panel = VECTORS * Arch::new().dispatch(NumLanes);
        let num_panels = num_outputs.div_ceil(panel);
        let mut panels = vec![0.0; num_panels * num_inputs * panel];
        for n in 0..num_outputs {
            for k in 0..num_inputs {
                panels[(n / panel * num_inputs + k) * panel + n % panel] = weights[n * num_inputs + k];
            }
        }
        let mut padded_bias = bias.to_vec();
        padded_bias.resize(num_panels * panel, 0.0);
        Self { num_inputs, num_outputs, panels, bias: padded_bias }
    }

    /// `output[i] = activation(W input[i] + bias)` for pixel-major `input` and `output`.
    #[inline(always)]
    pub(crate) fn apply<S: Simd>(&self, simd: S, input: &[f32], output: &mut [f32], activation: Activation) {
        let panel_len = VECTORS * S::F32_LANES;
        let (num_inputs, num_outputs) = (self.num_inputs, self.num_outputs);
        let num_pixels = input.len() / num_inputs;
        for (p, panel) in self.panels.chunks_exact(num_inputs * panel_len).enumerate() {
            let start = p * panel_len;
            let panel = Panel {
                weights: S::as_simd_f32s(panel).0.as_chunks().0,
                bias: S::as_simd_f32s(&self.bias[start..][..panel_len]).0.as_chunks().0[0],
                start,
                len: panel_len.min(num_outputs - start),
                num_outputs,
                activation,
            };
            let whole = num_pixels / ROWS * ROWS;
            let (input, rest) = input.split_at(whole * num_inputs);
            let (output, rest_output) = output.split_at_mut(whole * num_outputs);
            let blocks = input.chunks_exact(ROWS * num_inputs);
            for (block, target) in blocks.zip(output.chunks_exact_mut(ROWS * num_outputs)) {
                panel.apply::<ROWS>(simd, block, target);
            }
            for (row, target) in rest.chunks_exact(num_inputs).zip(rest_output.chunks_exact_mut(num_outputs)) {
                panel.apply::<1>(simd, row, target);
            }
        }
    }
}

/// The weights of a few neighbouring outputs.
struct Panel<'a, S: Simd> {
    weights: &'a [[S::f32s; VECTORS]],
    bias: [S::f32s; VECTORS],
    start: usize,
    len: usize,
    num_outputs: usize,
    activation: Activation,
}

impl<S: Simd> Panel<'_, S> {
    #[inline(always)]
    fn apply<const R: usize>(&self, simd: S, input: &[f32], output: &mut [f32]) {
        let num_inputs = self.weights.len();
        let rows: [&[f32]; R] = std::array::from_fn(|r| &input[r * num_inputs..][..num_inputs]);
        let mut sums = [self.bias; R];
        for (k, weights) in self.weights.iter().enumerate() {
            for r in 0..R {
                let value = simd.splat_f32s(rows[r][k]);
                for v in 0..VECTORS {
                    sums[r][v] = simd.mul_add_e_f32s(value, weights[v], sums[r][v]);
                }
            }
        }
        for (r, sums) in sums.iter().enumerate() {
            let target = &mut output[r * self.num_outputs + self.start..][..self.len];
            for (part, &sum) in target.chunks_mut(S::F32_LANES).zip(sums) {
                let value = self.activation.apply(simd, sum);
                match S::as_mut_simd_f32s(part) {
                    ([whole], _) => *whole = value,
                    (_, tail) => simd.partial_store_f32s(tail, value),
                }
            }
        }
    }
}

/// Floats per vector on this machine.
struct NumLanes;

impl WithSimd for NumLanes {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        S::F32_LANES
    }
}
