//! The mean over the pixels that count.
//!
//! Invariant: without any such pixel the mean is 0 and so are its gradients.

use burn::tensor::{Bool, Tensor};

/// Mean of `values` where `counts`; values elsewhere must be finite.
pub(crate) fn mean_where<const D: usize>(values: Tensor<D>, counts: Tensor<D, Bool>) -> Tensor<1> {
    let counts = counts.float();
    let number = counts.clone().sum().clamp_min(1.0);
    (values * counts).sum() / number
}
