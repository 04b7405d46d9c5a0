//! The inverted residual block: expand 1x1, depthwise, project 1x1, plus the input where shapes agree.
//!
//! The wide map between expand and project is six times the block's input; it is never stored. Each
//! band of output rows keeps a ring of as many expanded rows as the depthwise filter is tall.
//! Invariant: every output value is computed by the same sums whatever the bands.

use crate::FeatureMap;
use crate::depthwise::Depthwise;
use crate::pointwise::{Activation, Pointwise};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// One block with BatchNorm folded in.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// Absent in the first block, whose depthwise filter reads the input itself.
    pub(super) expand: Option<Pointwise>,
    pub(super) depthwise: Depthwise,
    pub(super) project: Pointwise,
}

impl Block {
    fn num_inputs(&self) -> usize {
        self.expand.as_ref().map_or(self.depthwise.channels, |e| e.num_inputs)
    }

    /// The block's output map; width and height are divisible by the stride.
    pub(super) fn run(&self, input: &FeatureMap) -> FeatureMap {
        let stride = self.depthwise.stride;
        let (width, height) = (input.width / stride, input.height / stride);
        let channels = self.project.num_outputs;
        let mut data = vec![0.0; width * height * channels];
        // Two bands per thread balance the load; short bands would expand their border rows twice too often.
        let band = height.div_ceil(2 * rayon::current_num_threads()).clamp(4, 64);
        data.par_chunks_mut(band * width * channels)
            .enumerate()
            .for_each(|(i, output)| Arch::new().dispatch(Band { block: self, input, first_row: i * band, output }));
        FeatureMap { channels, width, height, stride: input.stride * stride, data }
    }
}

/// Consecutive output rows, computed by one thread.
struct Band<'a> {
    block: &'a Block,
    input: &'a FeatureMap,
    first_row: usize,
    output: &'a mut [f32],
}

impl WithSimd for Band<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { block, input, first_row, output } = self;
        let Depthwise { channels, kernel, stride, .. } = block.depthwise;
        let (width, row_len) = (input.width / stride, block.project.num_outputs * (input.width / stride));
        // "Same" padding for sizes divisible by the stride: `kernel - stride` in all, the odd one after.
        let before = (kernel - stride) / 2;
        let padded_len = (input.width + kernel - stride) * channels;
        let mut ring = vec![0.0; kernel * padded_len];
        let mut wide = vec![0.0; width * channels];
        let residual = stride == 1 && block.num_inputs() == block.project.num_outputs;

        let mut num_expanded = first_row * stride;
        for (i, out_row) in output.chunks_exact_mut(row_len).enumerate() {
            let top = (first_row + i) * stride;
            while num_expanded < top + kernel {
                let padded = &mut ring[num_expanded % kernel * padded_len..][..padded_len];
                let inside = num_expanded.checked_sub(before).filter(|&y| y < input.height);
                block.expand_row(simd, input, inside, before, padded);
                num_expanded += 1;
            }
            let mut rows = [&ring[..0]; 5];
            for (dy, row) in rows[..kernel].iter_mut().enumerate() {
                *row = &ring[(top + dy) % kernel * padded_len..][..padded_len];
            }
            block.depthwise.row(simd, &rows[..kernel], &mut wide);
            block.project.apply(simd, &wide, out_row, Activation::Linear);
            if residual {
                let source = &input.data[(first_row + i) * row_len..][..row_len];
                for (out, value) in out_row.iter_mut().zip(source) {
                    *out += value;
                }
            }
        }
    }
}

impl Block {
    /// Input row `y` expanded into the middle of a padded row; zeros when `y` lies outside the map.
    #[inline(always)]
    fn expand_row<S: Simd>(&self, simd: S, input: &FeatureMap, y: Option<usize>, before: usize, padded: &mut [f32]) {
        let Some(y) = y else {
            padded.fill(0.0);
            return;
        };
        let channels = self.depthwise.channels;
        let row = &input.data[y * input.width * input.channels..][..input.width * input.channels];
        let (left, rest) = padded.split_at_mut(before * channels);
        let (middle, right) = rest.split_at_mut(input.width * channels);
        left.fill(0.0);
        right.fill(0.0);
        match &self.expand {
            Some(expand) => expand.apply(simd, row, middle, Activation::Relu6),
            None => middle.copy_from_slice(row),
        }
    }
}
