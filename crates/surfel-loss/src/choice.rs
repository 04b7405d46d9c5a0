//! Which of the proposed planes is right: the term that teaches a network to choose (departure 16 of `PAPER.md`).
//!
//! The depth term reaches the scores only through the softmax, where a plane that is hardly believed hardly learns;
//! this one tells every score what it should be. Invariant: zero when the belief equals the target, and a block for
//! which nobody proposes anything right says nothing.

use crate::mean::weighted_mean;
use burn::tensor::Tensor;
use burn::tensor::activation::{log_softmax, softmax};

/// Error, in steps, by which a plane must be worse to be believed `e` times less.
const TOLERANCE_STEPS: f64 = 0.1;
/// Largest error of the best proposal of a block that has one, steps.
const RIGHT_STEPS: f64 = 1.5;
/// Largest error that counts, steps.
const LARGEST_STEPS: f64 = 16.0;

/// Divergence of the belief, `softmax(scores)`, from what the errors of the proposals say of them; mean over blocks,
/// each `counts` times, 0 without truth.
///
/// `scores` and `errors`, of inverse depth in steps, are `[views, proposals, rows, columns]`; `counts` has 1 proposal.
///
/// # Panics
/// If they differ in size (a programmer's error).
pub fn choice(scores: Tensor<4>, errors: Tensor<4>, counts: Tensor<4>) -> Tensor<1> {
    let errors = errors.abs().clamp_max(LARGEST_STEPS);
    let counts = counts * errors.clone().min_dim(1).lower_elem(RIGHT_STEPS).float();
    let target = softmax(-errors.clone() / TOLERANCE_STEPS, 1);
    let log_target = log_softmax(-errors / TOLERANCE_STEPS, 1);
    let divergence = (target * (log_target - log_softmax(scores, 1))).sum_dim(1);
    weighted_mean(divergence.flatten(0, 3), counts.flatten(0, 3))
}
