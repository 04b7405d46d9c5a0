//! The gather attention as a kernel that burn differentiates through.
//!
//! Invariant: no gradient flows to the regions.

use crate::ops::count;
use crate::ops::gather_attention::{self as attention, Inputs, Regions};
use crate::ops::kernel::{Kernel, SLOTS, run};
use burn::tensor::Tensor;
use std::sync::Arc;

/// What is neither query, key nor value; those are its inputs, in this order.
#[derive(Debug)]
struct Gather {
    /// Surfels and channels.
    shape: [usize; 2],
    num_heads: usize,
    regions: Arc<Regions>,
}

impl Gather {
    fn inputs<'a>(&self, inputs: &[&'a [f32]; SLOTS]) -> Inputs<'a> {
        let [query, key, value, ..] = *inputs;
        Inputs { query, key, value, channels: self.shape[1], num_heads: self.num_heads }
    }
}

impl Kernel for Gather {
    fn shape(&self) -> Vec<usize> {
        self.shape.to_vec()
    }

    fn forward(&self, inputs: &[&[f32]; SLOTS]) -> Vec<f32> {
        attention::forward(&self.inputs(inputs), &self.regions)
    }

    fn backward(&self, inputs: &[&[f32]; SLOTS], grad: &[f32], _: [bool; SLOTS]) -> [Option<Vec<f32>>; SLOTS] {
        // All three come of the same pass.
        let grads = attention::backward(&self.inputs(inputs), &self.regions, grad);
        [Some(grads.query), Some(grads.key), Some(grads.value), None, None]
    }
}

/// Attention of each surfel over its regions; all tensors `[surfels, channels]`.
pub fn gather_attention(
    query: Tensor<2>,
    key: Tensor<2>,
    value: Tensor<2>,
    num_heads: usize,
    regions: Arc<Regions>,
) -> Tensor<2> {
    let device = query.device();
    let samples = regions.windows.iter().map(|window| u64::from(window.mask.count_ones())).sum::<u64>();
    // Scores and weighted sums.
    count::tell(2 * samples * query.dims()[1] as u64);
    let kernel = Gather { shape: query.dims(), num_heads, regions };
    let [query, key, value] = [query, key, value].map(Tensor::into_dispatch);
    run(&device, [query, key, value], kernel)
}
