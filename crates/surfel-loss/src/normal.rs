//! The normal term: squared difference of unit normals (paper: `L_n`; spec 4.3).
//!
//! Invariant: which pixels have a true normal is said by a mask, never guessed from its value.

use crate::mean::mean_where;
use burn::tensor::Tensor;

/// Keeps the direction of a blended normal of length 0 finite; lengths that matter are far above its root.
const TINY: f64 = 1e-12;

/// Mean of `|n / |n| - truth|²`, at most 4, over pixels where `mask` is above one half and a normal was rendered.
///
/// `blended` and `truth` are `[3, height, width]` in one frame, `truth` of unit length where it counts and anything
/// elsewhere; `mask` is `[height, width]`.
///
/// # Panics
/// If the maps differ in size (a programmer's error).
pub fn normal(blended: Tensor<3>, truth: Tensor<3>, mask: Tensor<2>) -> Tensor<1> {
    let length_sq = blended.clone().square().sum_dim(0);
    let counts = mask.unsqueeze_dim::<3>(0).greater_scalar(0.5).bool_and(length_sq.clone().greater_scalar(0.0));
    let truth_dims = truth.dims();
    let truth = truth.mask_fill(counts.clone().bool_not().expand(truth_dims), 0.0);
    let unit = blended / (length_sq + TINY).sqrt();
    mean_where((unit - truth).square().sum_dim(0), counts)
}
