//! The depth term of networks that start from matching: robust, in steps (paper: `L_d`; spec 4.3).
//!
//! A step is the inverse depth that moves a neighbour's pixel by about one, so an error is a parallax. Invariant: no
//! error counts more than its largest, so a pixel that cannot be matched does not drown those that can.

use crate::mean::weighted_mean;
use burn::tensor::Tensor;

/// Error, in steps, below which the term is nearly linear and above which it grows ever slower.
const KNEE_STEPS: f64 = 0.25;
/// Share of the plain absolute error, which keeps large mistakes worth mending.
const LINEAR: f64 = 0.1;
/// Largest error that counts, steps.
const LARGEST_STEPS: f64 = 16.0;

/// Mean of `knee ln(1 + |e| / knee) + |e| / 10` over errors `e` of inverse depth, steps; each `counts` times, 0 without
/// truth. Both are `[views, height, width]`.
///
/// # Panics
/// If the maps differ in size (a programmer's error).
pub fn depth_in_steps(error: Tensor<3>, counts: Tensor<3>) -> Tensor<1> {
    let error = error.abs().clamp_max(LARGEST_STEPS);
    let robust = (error.clone() / KNEE_STEPS).log1p() * KNEE_STEPS + error * LINEAR;
    weighted_mean(robust.flatten(0, 2), counts.flatten(0, 2))
}
