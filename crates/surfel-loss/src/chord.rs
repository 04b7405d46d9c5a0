//! The normal term of networks that start from matching: the distance of unit normals (paper: `L_n`; spec 4.3).
//!
//! The chord itself, not its square as in the paper: squares pull towards the mean of the doubtful. Invariant: which
//! normals are true is said by their counts, never guessed from their values.

use crate::mean::weighted_mean;
use burn::tensor::Tensor;

/// Keeps the slope of the root finite where normals agree; a hundredth of a radian there.
const TINY: f64 = 1e-4;

/// Mean of `|n - truth|` over unit normals, each `counts` times, 0 without truth.
///
/// `normals` and `truth` are `[normals, 3]` in one frame, `truth` finite everywhere; `counts` is `[normals]`.
///
/// # Panics
/// If they differ in length (a programmer's error).
pub fn chord(normals: Tensor<2>, truth: Tensor<2>, counts: Tensor<1>) -> Tensor<1> {
    let chord = ((normals - truth).powi_scalar(2).sum_dim(1) + TINY).sqrt();
    weighted_mean(chord.squeeze_dim::<1>(1), counts)
}
