//! Two-dimensional convolution of `[images, channels, height, width]` maps and its gradients, on plain slices.
//!
//! Direct: every tap of a row of outputs reads a run of neighbouring values of a padded copy, so nothing like
//! an unfolded matrix is ever written. Invariant: every sum runs in an order that the sizes alone decide.

mod blocks;
mod gather;
mod padded;
mod products;
mod weights;

pub use weights::{bias_gradient, weight_gradient};

use blocks::{Source, Target, sweep};
use gather::Phase;
use padded::Padded;

/// Floats of one padded block of rows: it should stay in a core's second-level cache beside the weights.
const BLOCK_FLOATS: usize = 48 * 1024;
/// Most rows of outputs per block; more would leave too few blocks to share among threads.
const MOST_ROWS: usize = 8;

/// The sizes of a convolution with a square kernel, equal strides, and zeros on all four sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conv {
    /// Maps.
    pub images: usize,
    /// Channels of the input.
    pub inputs: usize,
    /// Channels of the output.
    pub outputs: usize,
    /// Taps per side.
    pub kernel: usize,
    /// Input pixels per output pixel.
    pub stride: usize,
    /// Zeros added on each side; less than `kernel`.
    pub padding: usize,
    /// Rows of the input.
    pub height: usize,
    /// Columns of the input.
    pub width: usize,
}

impl Conv {
    /// Rows and columns of the output; zero where the kernel does not fit.
    pub fn output_size(&self) -> (usize, usize) {
        let size = |n: usize| match (n + 2 * self.padding).checked_sub(self.kernel) {
            Some(rest) => rest / self.stride + 1,
            None => 0,
        };
        (size(self.height), size(self.width))
    }

    /// Weights per output channel.
    pub(super) fn taps(&self) -> usize {
        self.inputs * self.kernel * self.kernel
    }

    /// How a block with `rows` rows of outputs reads its inputs.
    fn padded_input(&self, rows: usize) -> Padded {
        Padded {
            channels: self.inputs,
            rows: (rows - 1) * self.stride + self.kernel,
            columns: self.output_size().1,
            reach: self.kernel - 1,
            step: self.stride,
            before: self.padding,
        }
    }

    /// Where in a padded block the input of each tap lies, in the order of the weights of one output.
    fn tap_offsets(&self, padded: &Padded) -> Vec<usize> {
        let k = self.kernel;
        (0..self.taps()).map(|i| padded.offset(i / (k * k), i / k % k, i % k)).collect()
    }

    fn check(&self, input: usize, weight: usize) {
        assert!(self.padding < self.kernel && self.stride > 0, "{self:?} is no convolution");
        assert_eq!(input, self.images * self.inputs * self.height * self.width, "input of {self:?}");
        assert_eq!(weight, self.outputs * self.taps(), "weights of {self:?}");
    }
}

/// The output `[images, outputs, rows, columns]` of an input `[images, inputs, height, width]`, weights
/// `[outputs, inputs, kernel, kernel]` and one bias per output.
pub fn forward(conv: &Conv, input: &[f32], weight: &[f32], bias: Option<&[f32]>) -> Vec<f32> {
    conv.check(input.len(), weight.len());
    let (height, width) = conv.output_size();
    let rows = rows_per_block(height, |rows| conv.padded_input(rows).len());
    let padded = conv.padded_input(rows);
    let phase =
        Phase::new((0, 0), conv.tap_offsets(&padded), conv.outputs, |output, tap| weight[output * conv.taps() + tap]);
    let phases = [phase];
    let source = Source { values: input, channels: conv.inputs, height: conv.height, width: conv.width };
    let first_row = |row: usize| (row * conv.stride) as isize - conv.padding as isize;
    sweep(&source, &padded, first_row, &phases, bias, Target { channels: conv.outputs, height, width, rows, step: 1 })
}

/// The gradient of the input, given that of the output.
pub fn input_gradient(conv: &Conv, grad: &[f32], weight: &[f32]) -> Vec<f32> {
    let (height, width) = conv.output_size();
    conv.check(conv.images * conv.inputs * conv.height * conv.width, weight.len());
    assert_eq!(grad.len(), conv.images * conv.outputs * height * width, "gradient of {conv:?}");
    let (kernel, stride) = (conv.kernel, conv.stride);
    // Input pixel `stride i + phase` was read by output pixel `i + (phase + padding - tap) / stride`, for
    // every tap that divides evenly. `before` makes the smallest of these offsets zero.
    let before = (kernel - 1 - conv.padding).div_ceil(stride);
    let after = conv.padding.div_ceil(stride);
    let blocks = |rows: usize| Padded {
        channels: conv.outputs,
        rows: rows + before + after,
        columns: conv.width.div_ceil(stride),
        reach: before + after,
        step: 1,
        before,
    };
    let rows = rows_per_block(conv.height.div_ceil(stride), |rows| blocks(rows).len());
    let padded = blocks(rows);
    let taps_of = |phase: usize| -> Vec<(usize, usize)> {
        let place = |tap: usize| (before * stride + phase + conv.padding) - tap;
        (0..kernel).filter(|&tap| place(tap).is_multiple_of(stride)).map(|tap| (tap, place(tap) / stride)).collect()
    };
    let phases: Vec<Phase> = (0..stride * stride)
        .map(|phase| {
            let (down, right) = (phase / stride, phase % stride);
            let mut taps = Vec::new();
            for output in 0..conv.outputs {
                for &(ky, row) in &taps_of(down) {
                    for &(kx, column) in &taps_of(right) {
                        taps.push((output, ky * kernel + kx, padded.offset(output, row, column)));
                    }
                }
            }
            let offsets = taps.iter().map(|tap| tap.2).collect();
            Phase::new((down, right), offsets, conv.inputs, |input, tap| {
                let (output, place, _) = taps[tap];
                weight[(output * conv.inputs + input) * kernel * kernel + place]
            })
        })
        .collect();
    let source = Source { values: grad, channels: conv.outputs, height, width };
    let target =
        Target { channels: conv.inputs, height: conv.height, width: conv.width, rows: rows * stride, step: stride };
    sweep(&source, &padded, |row| (row / stride) as isize - before as isize, &phases, None, target)
}

/// As many rows as keep a block within its budget.
fn rows_per_block(height: usize, floats: impl Fn(usize) -> usize) -> usize {
    (1..=MOST_ROWS.min(height.max(1))).rev().find(|&rows| floats(rows) <= BLOCK_FLOATS).unwrap_or(1)
}
