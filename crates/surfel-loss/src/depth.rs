//! The depth term: distance to measured z-depth in units of the depth range (paper: `L_d`; spec 4.3).
//!
//! Invariant: only pixels with truth inside the range and with a predicted depth count, since 0 means no depth.

use crate::mean::mean_where;
use burn::tensor::Tensor;
use surfel_net::DepthRange;

/// Share of the absolute and of the squared distance (spec 4.2).
const ABSOLUTE: f64 = 0.9;
const SQUARED: f64 = 0.1;

/// `0.9 |e| + 0.1 e²`, averaged, of `e = (depth - truth) / (far - near)`; maps `[height, width]` in scene units.
///
/// Truth that is 0, not finite or outside the range does not count.
///
/// # Panics
/// If the maps differ in size (a programmer's error).
pub fn depth(depth: Tensor<2>, truth: Tensor<2>, range: &DepthRange) -> Tensor<1> {
    let counts = truth
        .clone()
        .greater_equal_scalar(range.near)
        .bool_and(truth.clone().lower_equal_scalar(range.far))
        .bool_and(depth.clone().greater_scalar(0.0));
    let truth = truth.mask_fill(counts.clone().bool_not(), 0.0);
    let error = (depth - truth) / (range.far - range.near);
    mean_where(error.clone().abs() * ABSOLUTE + error.square() * SQUARED, counts)
}
