//! The opacity term of networks whose opacity is a probability: that the depth is right (departure 16 of `PAPER.md`).
//!
//! Beside [`crate::opacity`], which only asks for a decision. Invariant: the least value is reached by the true
//! probability of being right, whatever the depth is.

use crate::mean::weighted_mean;
use burn::tensor::Tensor;

/// Relative depth error up to which a pixel counts as right.
const RIGHT: f64 = 0.01;
/// Opacities are kept this far from 0 and 1, where the logarithm ends.
const FINEST: f64 = 1e-4;

/// Mean cross-entropy of `opacity`, in \[0, 1\], against whether the depth is within 1 % of a surface.
///
/// `relative_error` is of the depth, at least 0; `has_surface` is 1 where there is one to be near, 0 elsewhere: where
/// there is none the opacity should be low as well. `known` is 1 where that much is known, `None` where it is
/// everywhere. All are `[views, height, width]`.
///
/// # Panics
/// If the maps differ in size (a programmer's error).
pub fn calibrated_opacity(
    opacity: Tensor<3>,
    relative_error: Tensor<3>,
    has_surface: Tensor<3>,
    known: Option<Tensor<3>>,
) -> Tensor<1> {
    let right = relative_error.lower_equal_elem(RIGHT).float() * has_surface;
    let opacity = opacity.clamp(FINEST, 1.0 - FINEST);
    let entropy = -(right.clone() * opacity.clone().log() + (-right + 1.0) * (-opacity + 1.0).log());
    match known {
        Some(known) => weighted_mean(entropy.flatten(0, 2), known.flatten(0, 2)),
        None => entropy.mean(),
    }
}
