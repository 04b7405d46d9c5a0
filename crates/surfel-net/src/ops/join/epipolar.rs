//! Epipolar attention as a kernel that burn differentiates through.
//!
//! Invariant: no gradient flows to cameras or depths.

use crate::ops::count;
use crate::ops::epipolar::EpipolarLines;
use crate::ops::epipolar_attention::{self as attention, Inputs};
use crate::ops::kernel::{Kernel, SLOTS, run};
use burn::tensor::Tensor;
use std::sync::Arc;

/// What is neither query, key, value nor what depths add to keys and values; those are its inputs, in this order.
#[derive(Debug)]
struct Along {
    shape: [usize; 4],
    num_heads: usize,
    lines: Arc<EpipolarLines>,
}

impl Along {
    fn inputs<'a>(&self, [query, key, value, depth_key, depth_value]: [&'a [f32]; SLOTS]) -> Inputs<'a> {
        Inputs { query, key, value, depth_key, depth_value, channels: self.shape[3], num_heads: self.num_heads }
    }
}

impl Kernel for Along {
    fn shape(&self) -> Vec<usize> {
        self.shape.to_vec()
    }

    fn forward(&self, inputs: &[&[f32]; SLOTS]) -> Vec<f32> {
        attention::forward(&self.inputs(*inputs), &self.lines)
    }

    fn backward(&self, inputs: &[&[f32]; SLOTS], grad: &[f32], _: [bool; SLOTS]) -> [Option<Vec<f32>>; SLOTS] {
        // All five come of the same two passes.
        let grads = attention::backward(&self.inputs(*inputs), &self.lines, grad);
        [grads.query, grads.key, grads.value, grads.depth_key, grads.depth_value].map(Some)
    }
}

/// Attention of each pixel along its lines: queries, keys and values `[views, height, width, channels]`, and what
/// each candidate of depth adds to keys and values `[candidates, channels]`.
pub fn epipolar_attention(
    query: Tensor<4>,
    [key, value]: [Tensor<4>; 2],
    [depth_key, depth_value]: [Tensor<2>; 2],
    num_heads: usize,
    lines: Arc<EpipolarLines>,
) -> Tensor<4> {
    let neighbours = lines.warps.iter().map(Vec::len).sum::<usize>();
    // Scores and weighted sums of interpolated keys and values; landings outside the neighbour are counted as well.
    count::tell_product(&[2, neighbours, lines.num_pixels(), lines.num_candidates(), query.dims()[3]]);
    let device = query.device();
    let kernel = Along { shape: query.dims(), num_heads, lines };
    let [query, key, value] = [query, key, value].map(Tensor::into_dispatch);
    let [depth_key, depth_value] = [depth_key, depth_value].map(Tensor::into_dispatch);
    run(&device, [query, key, value, depth_key, depth_value], kernel)
}
