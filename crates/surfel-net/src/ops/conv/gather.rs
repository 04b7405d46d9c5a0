//! The inner loop of the convolution and of its input gradient: a few output channels times two vectors of
//! neighbouring pixels, summed over all taps.
//!
//! Invariant: each sum starts from the bias and runs over the taps in order, whatever the block sizes.

use crate::ops::vector::store;
use pulp::{Simd, WithSimd};
use std::ops::Range;

/// Output channels computed together at most: 6 x 2 sums fill the sixteen AVX registers with room for operands.
const MOST_CHANNELS: usize = 6;
/// Vectors of neighbouring pixels computed together.
const VECTORS: usize = 2;
/// Floats in that many vectors of the longest kind.
const MOST_FLOATS: usize = 32;

/// What the outputs of one remainder of rows and columns are made of.
pub(super) struct Phase {
    /// The remainder of row and column modulo the step of the target.
    place: (usize, usize),
    /// Where the taps lie in the padded block.
    offsets: Vec<usize>,
    /// Nearly equal blocks of output channels.
    blocks: Vec<Range<usize>>,
    /// Block by block, `[taps, channels of the block]`.
    weights: Vec<f32>,
}

impl Phase {
    /// `weight` is asked for output channel and tap.
    pub(super) fn new(
        place: (usize, usize),
        offsets: Vec<usize>,
        num_channels: usize,
        weight: impl Fn(usize, usize) -> f32,
    ) -> Self {
        let num_blocks = num_channels.div_ceil(MOST_CHANNELS);
        let blocks: Vec<Range<usize>> =
            (0..num_blocks).map(|b| b * num_channels / num_blocks..(b + 1) * num_channels / num_blocks).collect();
        let mut weights = Vec::with_capacity(num_channels * offsets.len());
        for block in &blocks {
            for tap in 0..offsets.len() {
                weights.extend(block.clone().map(|channel| weight(channel, tap)));
            }
        }
        Self { place, offsets, blocks, weights }
    }
}

/// One phase of one block of rows.
pub(super) struct Stripe<'a, 'b> {
    pub(super) phase: &'a Phase,
    pub(super) bias: Option<&'a [f32]>,
    pub(super) patch: &'a [f32],
    /// Floats in the patch from one output row of the phase to the next.
    pub(super) patch_row: usize,
    /// Rows and columns of the target from one output of the phase to the next.
    pub(super) step: usize,
    /// Columns of the target.
    pub(super) width: usize,
    /// The rows of each output channel.
    pub(super) rows: &'a mut [&'b mut [f32]],
}

impl WithSimd for Stripe<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (down, right) = self.phase.place;
        let num_rows = (self.rows[0].len() / self.width).saturating_sub(down).div_ceil(self.step);
        let num_columns = self.width.saturating_sub(right).div_ceil(self.step);
        for row in 0..num_rows {
            let mut column = 0;
            while column < num_columns {
                let patch = &self.patch[row * self.patch_row + column..];
                let len = (num_columns - column).min(VECTORS * S::F32_LANES);
                if len > S::F32_LANES {
                    self.all_channels::<S, VECTORS>(simd, patch, row, column, len);
                } else {
                    self.all_channels::<S, 1>(simd, patch, row, column, len);
                }
                column += len;
            }
        }
    }
}

impl Stripe<'_, '_> {
    #[inline(always)]
    fn all_channels<S: Simd, const V: usize>(&mut self, simd: S, patch: &[f32], row: usize, column: usize, len: usize) {
        let phase = self.phase;
        let mut start = 0;
        for block in &phase.blocks {
            let weights = &phase.weights[start..][..block.len() * phase.offsets.len()];
            start += weights.len();
            let at = Tile { patch, weights, first: block.start, row, column, len };
            match block.len() {
                1 => self.tile::<S, 1, V>(simd, at),
                2 => self.tile::<S, 2, V>(simd, at),
                3 => self.tile::<S, 3, V>(simd, at),
                4 => self.tile::<S, 4, V>(simd, at),
                5 => self.tile::<S, 5, V>(simd, at),
                _ => self.tile::<S, MOST_CHANNELS, V>(simd, at),
            }
        }
    }

    /// `M` channels, `V` vectors.
    #[inline(always)]
    fn tile<S: Simd, const M: usize, const V: usize>(&mut self, simd: S, tile: Tile) {
        let bias = |m: usize| self.bias.map_or(0.0, |bias| bias[tile.first + m]);
        let mut sums: [[S::f32s; V]; M] = std::array::from_fn(|m| [simd.splat_f32s(bias(m)); V]);
        for (&offset, weights) in self.phase.offsets.iter().zip(tile.weights.as_chunks::<M>().0) {
            let values = S::as_simd_f32s(&tile.patch[offset..][..V * S::F32_LANES]).0.as_chunks::<V>().0[0];
            for m in 0..M {
                let weight = simd.splat_f32s(weights[m]);
                for v in 0..V {
                    sums[m][v] = simd.mul_add_e_f32s(weight, values[v], sums[m][v]);
                }
            }
        }
        let (down, right) = self.phase.place;
        let row = (tile.row * self.step + down) * self.width;
        for (m, sums) in sums.iter().enumerate() {
            let target = &mut self.rows[tile.first + m][row..][..self.width];
            if self.step == 1 {
                store_run(simd, &mut target[tile.column..][..tile.len], sums);
            } else {
                let mut run = [0.0; MOST_FLOATS];
                store_run(simd, &mut run[..tile.len], sums);
                let target = target[tile.column * self.step + right..].iter_mut().step_by(self.step);
                target.zip(&run[..tile.len]).for_each(|(target, &value)| *target = value);
            }
        }
    }
}

/// Some channels of a run of pixels.
#[derive(Clone, Copy)]
struct Tile<'a> {
    patch: &'a [f32],
    weights: &'a [f32],
    first: usize,
    row: usize,
    column: usize,
    len: usize,
}

/// Writes the first `target.len()` floats.
#[inline(always)]
fn store_run<S: Simd>(simd: S, target: &mut [f32], values: &[S::f32s]) {
    for (part, &value) in target.chunks_mut(S::F32_LANES).zip(values) {
        store(simd, part, value);
    }
}
