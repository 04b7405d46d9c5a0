//! The photometric term: mean squared difference of colours (paper: `L_render`; spec 4.3).
//!
//! Invariant: zero exactly for equal pictures.

use burn::tensor::Tensor;

/// Mean over pixels and channels of the squared difference of two pictures `[3, height, width]`, sRGB in \[0, 1\].
///
/// # Panics
/// If the pictures differ in size (a programmer's error).
pub fn photometric(picture: Tensor<3>, photograph: Tensor<3>) -> Tensor<1> {
    (picture - photograph).square().mean()
}
