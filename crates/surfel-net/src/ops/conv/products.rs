//! The inner loop of the weight gradient: a few output channels times a few taps, summed over pixels.
//!
//! Invariant: vectors run along a row and are only added up at the end of a block of rows.

use pulp::{Simd, WithSimd};

/// Output channels and taps computed together at most: 4 x 3 sums and 7 operands in sixteen registers.
const MOST_CHANNELS: usize = 4;
const MOST_TAPS: usize = 3;

/// Adds the products of one block of rows to sums `[outputs, taps]`.
pub(super) struct Products<'a> {
    /// Padded inputs and gradients of the outputs.
    pub(super) inputs: &'a [f32],
    pub(super) grads: &'a [f32],
    /// Where in `inputs` the taps and in `grads` the output channels begin.
    pub(super) taps: &'a [usize],
    pub(super) outputs: &'a [usize],
    /// What is multiplied: a number of runs of some length, each so many floats after the one before. Where
    /// a run is longer than a row of outputs, or a vector than what is left of it, the gradients are zero.
    pub(super) num_runs: usize,
    pub(super) run_len: usize,
    pub(super) input_step: usize,
    pub(super) grad_step: usize,
    /// From the first tap of the first output on, and the floats from one output to the next.
    pub(super) sums: &'a mut [f32],
    pub(super) sums_row: usize,
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let mut first = 0;
        while first < self.outputs.len() {
            let channels = (self.outputs.len() - first).min(MOST_CHANNELS);
            match channels {
                1 => self.all_taps::<S, 1>(simd, first),
                2 => self.all_taps::<S, 2>(simd, first),
                3 => self.all_taps::<S, 3>(simd, first),
                _ => self.all_taps::<S, MOST_CHANNELS>(simd, first),
            }
            first += channels;
        }
    }
}

impl Products<'_> {
    #[inline(always)]
    fn all_taps<S: Simd, const M: usize>(&mut self, simd: S, first: usize) {
        let (triples, rest) = self.taps.as_chunks::<MOST_TAPS>();
        for (i, &offsets) in triples.iter().enumerate() {
            self.tile::<S, M, MOST_TAPS>(simd, first, i * MOST_TAPS, offsets);
        }
        for (i, &offset) in rest.iter().enumerate() {
            self.tile::<S, M, 1>(simd, first, triples.len() * MOST_TAPS + i, [offset]);
        }
    }

    /// `M` channels from `first` on, `T` taps from `tap` on.
    #[inline(always)]
    fn tile<S: Simd, const M: usize, const T: usize>(
        &mut self,
        simd: S,
        first: usize,
        tap: usize,
        offsets: [usize; T],
    ) {
        let num_vectors = self.run_len.div_ceil(S::F32_LANES);
        let len = num_vectors * S::F32_LANES;
        let outputs = self.outputs[first..].first_chunk::<M>().expect("the caller counts channels");
        let mut sums = [[simd.splat_f32s(0.0); T]; M];
        for run in 0..self.num_runs {
            let (grad_start, input_start) = (run * self.grad_step, run * self.input_step);
            // Loops, not `map`: only these let the compiler see the lengths.
            let (mut grads, mut inputs): ([&[S::f32s]; M], [&[S::f32s]; T]) = ([&[]; M], [&[]; T]);
            for m in 0..M {
                grads[m] = vectors::<S>(&self.grads[outputs[m] + grad_start..][..len], num_vectors);
            }
            for t in 0..T {
                inputs[t] = vectors::<S>(&self.inputs[offsets[t] + input_start..][..len], num_vectors);
            }
            for i in 0..num_vectors {
                let mut input = [simd.splat_f32s(0.0); T];
                for t in 0..T {
                    input[t] = inputs[t][i];
                }
                for m in 0..M {
                    let grad = grads[m][i];
                    for t in 0..T {
                        sums[m][t] = simd.mul_add_e_f32s(grad, input[t], sums[m][t]);
                    }
                }
            }
        }
        for m in 0..M {
            for t in 0..T {
                self.sums[(first + m) * self.sums_row + tap + t] += simd.reduce_sum_f32s(sums[m][t]);
            }
        }
    }
}

/// A whole number of vectors, told so that the compiler drops the checks of indices below it.
#[inline(always)]
fn vectors<S: Simd>(values: &[f32], num_vectors: usize) -> &[S::f32s] {
    &S::as_simd_f32s(values).0[..num_vectors]
}
