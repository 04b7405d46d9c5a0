//! The opacity term: surfels should be there or not (paper: opacities near 0 or 1; spec 2.8, 4.3).
//!
//! Invariant: zero exactly where every opacity is 0 or 1.

use burn::tensor::Tensor;

/// Mean of `o (1 - o)` over opacities in \[0, 1\], at most 1/4.
pub fn opacity(opacities: Tensor<1>) -> Tensor<1> {
    (opacities.clone() - opacities.square()).mean()
}
