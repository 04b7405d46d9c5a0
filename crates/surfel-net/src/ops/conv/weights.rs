//! Gradients of the weights and of the bias of a convolution.
//!
//! Invariant: the sums are split into parts that the sizes alone decide and added up in order, so the number of
//! threads changes nothing.

use super::Conv;
use super::padded::{GAP, Padded};
use super::products::Products;
use crate::ops::vector::sum;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Floats of the runs that are multiplied: few enough that those of some output channels and of one input
/// channel stay in a core's first-level cache, many enough that adding up a vector at the end costs little.
const RUN_FLOATS: usize = 1024;
/// Floats of a padded block of input channels; it should stay in a core's second-level cache.
const BLOCK_FLOATS: usize = 24 * 1024;
/// Most parts, and so most threads that can be used.
const MOST_PARTS: usize = 16;
/// Fewest output pixels per part: below this, adding the parts up costs more than it saves.
const PART_PIXELS: usize = 2048;
/// Maps summed by one task at least.
const SUMMED_TOGETHER: usize = 4;

/// The gradient of the weights `[outputs, inputs, kernel, kernel]`, given that of the output.
pub fn weight_gradient(conv: &Conv, input: &[f32], grad: &[f32]) -> Vec<f32> {
    let (height, width) = conv.output_size();
    let len = conv.outputs * conv.taps();
    conv.check(input.len(), len);
    assert_eq!(grad.len(), conv.images * conv.outputs * height * width, "gradient of {conv:?}");
    if len == 0 || height * width == 0 {
        return vec![0.0; len];
    }
    let blocks = Blocks::new(conv);
    let num_blocks = conv.images * blocks.per_image;
    let num_parts = (conv.images * height * width / PART_PIXELS).clamp(2, MOST_PARTS).min(num_blocks).max(1);
    let parts: Vec<Vec<f32>> = (0..num_parts)
        .into_par_iter()
        .map(|part| {
            let (mut inputs, mut grads) = (vec![0.0; blocks.inputs.len()], vec![0.0; blocks.grads.len()]);
            let mut sums = vec![0.0; len];
            for block in part * num_blocks / num_parts..(part + 1) * num_blocks / num_parts {
                let (image, row) = (block / blocks.per_image, block % blocks.per_image * blocks.rows);
                let input = &input[image * conv.inputs * conv.height * conv.width..];
                let grad = &grad[image * conv.outputs * height * width..];
                blocks.add(conv, input, grad, row, (&mut inputs, &mut grads), &mut sums);
            }
            sums
        })
        .collect();
    let mut parts = parts.into_iter();
    let mut total = parts.next().expect("there is at least one part");
    for part in parts {
        total.iter_mut().zip(&part).for_each(|(total, part)| *total += part);
    }
    total
}

/// How rows of outputs and groups of input channels are taken together.
struct Blocks {
    /// Rows of outputs per block.
    rows: usize,
    per_image: usize,
    /// Padded rows of a group of input channels, and of all gradients.
    inputs: Padded,
    grads: Padded,
    /// Where in the padded inputs the taps and in the padded gradients the output channels begin.
    taps: Vec<usize>,
    outputs: Vec<usize>,
}

impl Blocks {
    fn new(conv: &Conv) -> Self {
        let (height, width) = conv.output_size();
        // With steps of one, inputs and gradients get equal pitches: a block of rows is a single run.
        let reach = if conv.stride == 1 { conv.kernel - 1 } else { GAP };
        let rows = (RUN_FLOATS / (width + reach)).clamp(1, height);
        let grads = Padded { channels: conv.outputs, rows, columns: width, reach, step: 1, before: 0 };
        let mut inputs = conv.padded_input(rows);
        inputs.channels = (BLOCK_FLOATS / inputs.channel_len()).clamp(1, conv.inputs);
        let square = conv.kernel * conv.kernel;
        let place = |i: usize| inputs.offset(i / square, i / conv.kernel % conv.kernel, i % conv.kernel);
        Self {
            rows,
            per_image: height.div_ceil(rows),
            inputs,
            grads,
            taps: (0..inputs.channels * square).map(place).collect(),
            outputs: (0..conv.outputs).map(|output| grads.offset(output, 0, 0)).collect(),
        }
    }

    /// Adds what the outputs from `row` on contribute; `buffers` hold the padded blocks.
    fn add(
        &self,
        conv: &Conv,
        input: &[f32],
        grad: &[f32],
        row: usize,
        buffers: (&mut [f32], &mut [f32]),
        sums: &mut [f32],
    ) {
        let (inputs, grads) = buffers;
        let square = conv.kernel * conv.kernel;
        // Rows below the last are zeros and so add nothing.
        self.grads.fill(grad, conv.output_size(), row as isize, grads);
        for first in (0..conv.inputs).step_by(self.inputs.channels) {
            let channels = self.inputs.channels.min(conv.inputs - first);
            let first_row = (row * conv.stride) as isize - conv.padding as isize;
            let block = &mut inputs[..channels * self.inputs.channel_len()];
            self.inputs.fill(&input[first * conv.height * conv.width..], (conv.height, conv.width), first_row, block);
            let one_run = conv.stride == 1;
            Arch::new().dispatch(Products {
                inputs,
                grads,
                taps: &self.taps[..channels * square],
                outputs: &self.outputs,
                num_runs: if one_run { 1 } else { self.rows },
                run_len: if one_run { self.rows * self.grads.row_len() } else { self.grads.columns },
                input_step: conv.stride * self.inputs.row_len(),
                grad_step: self.grads.row_len(),
                sums: &mut sums[first * square..],
                sums_row: conv.taps(),
            });
        }
    }
}

/// The gradient of the bias: the sum of each output channel over images and pixels.
pub fn bias_gradient(conv: &Conv, grad: &[f32]) -> Vec<f32> {
    let (height, width) = conv.output_size();
    let len = height * width;
    assert_eq!(grad.len(), conv.images * conv.outputs * len, "gradient of {conv:?}");
    let sum_of = |output: usize| -> f32 {
        (0..conv.images)
            .map(|image| Arch::new().dispatch(Sum(&grad[(image * conv.outputs + output) * len..][..len])))
            .sum()
    };
    (0..conv.outputs).into_par_iter().with_min_len(SUMMED_TOGETHER).map(sum_of).collect()
}

struct Sum<'a>(&'a [f32]);

impl WithSimd for Sum<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        sum(simd, self.0)
    }
}
