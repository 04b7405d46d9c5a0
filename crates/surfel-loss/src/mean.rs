//! Means over the pixels that count.
//!
//! Invariant: without any such pixel the mean is 0 and so are its gradients.

use burn::tensor::{Bool, Tensor};

/// What keeps a mean without any weight finite; a single pixel weighs a million times as much.
const TINY: f64 = 1e-6;

/// Mean of `values` where `counts`; values elsewhere must be finite.
pub(crate) fn mean_where<const D: usize>(values: Tensor<D>, counts: Tensor<D, Bool>) -> Tensor<1> {
    let counts = counts.float();
    let number = counts.clone().sum().clamp_min(1.0);
    (values * counts).sum() / number
}

/// Mean of `values`, each with a weight of at least 0; values of weight 0 must be finite.
pub(crate) fn weighted_mean(values: Tensor<1>, weights: Tensor<1>) -> Tensor<1> {
    (values * weights.clone()).sum() / (weights.sum() + TINY)
}
