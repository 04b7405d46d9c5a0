//! Runs the inner loop of `gather` over blocks of rows, in parallel.
//!
//! Invariant: each block of the target is written by one task, from one padded block of the source.

use super::gather::{Phase, Stripe};
use super::padded::Padded;
use pulp::Arch;
use rayon::prelude::*;

/// Maps that are read.
pub(super) struct Source<'a> {
    pub(super) values: &'a [f32],
    pub(super) channels: usize,
    pub(super) height: usize,
    pub(super) width: usize,
}

/// Maps that are written, in blocks of `rows` rows; each phase writes every `step`-th row and column.
pub(super) struct Target {
    pub(super) channels: usize,
    pub(super) height: usize,
    pub(super) width: usize,
    pub(super) rows: usize,
    pub(super) step: usize,
}

/// Runs all phases over all blocks of rows; `first_row` tells where in the source a block of outputs begins.
pub(super) fn sweep(
    source: &Source,
    padded: &Padded,
    first_row: impl Fn(usize) -> isize + Sync,
    phases: &[Phase],
    bias: Option<&[f32]>,
    target: Target,
) -> Vec<f32> {
    let (map_len, image_len) = (target.height * target.width, source.channels * source.height * source.width);
    let num_images = source.values.len().checked_div(image_len).unwrap_or(0);
    let mut output = vec![0.0; num_images * target.channels * map_len];
    if output.is_empty() {
        return output;
    }
    let blocks_per_image = target.height.div_ceil(target.rows);
    let mut blocks: Vec<Vec<&mut [f32]>> = Vec::new();
    blocks.resize_with(num_images * blocks_per_image, || Vec::with_capacity(target.channels));
    for (i, map) in output.chunks_exact_mut(map_len).enumerate() {
        for (block, rows) in map.chunks_mut(target.rows * target.width).enumerate() {
            blocks[i / target.channels * blocks_per_image + block].push(rows);
        }
    }
    blocks.into_par_iter().enumerate().for_each_init(
        || vec![0.0; padded.len()],
        |patch, (block, mut rows)| {
            let (image, block) = (block / blocks_per_image, block % blocks_per_image);
            let first = first_row(block * target.rows);
            padded.fill(&source.values[image * image_len..], (source.height, source.width), first, patch);
            for phase in phases {
                Arch::new().dispatch(Stripe {
                    phase,
                    bias,
                    patch,
                    patch_row: padded.row_len() * if target.step == 1 { padded.step } else { 1 },
                    step: target.step,
                    width: target.width,
                    rows: &mut rows,
                });
            }
        },
    );
    output
}
