//! The alignment term: surfels lie in the surface that their depth describes (paper: `L_align`; spec 4.3).
//!
//! The paper's `sum_i w_i (1 - n_i . N)` over the surfels of a pixel is `alpha - blended . N`. Invariant: at least
//! zero, and zero where every surfel blended into a pixel faces as the depth map does.

use crate::depth_normals::{depth_normals, interior};
use burn::tensor::Tensor;
use surfel_core::Intrinsics;

/// Mean over interior pixels of `alpha - blended . N`, with `N` the unit normal of the rendered `depth`.
///
/// `alpha` and `depth` are `[height, width]`, `blended` the un-normalised normals `[3, height, width]` in the camera
/// frame. Pixels next to one without depth have no `N` and add nothing. Gradients flow to all three maps.
///
/// # Panics
/// If the maps differ in size (a programmer's error).
pub fn alignment(alpha: Tensor<2>, blended: Tensor<3>, depth: Tensor<2>, intrinsics: &Intrinsics) -> Tensor<1> {
    let Some(surface) = depth_normals(depth, intrinsics) else { return alpha.sum() * 0.0 };
    let agreement: Tensor<2> = (interior(blended) * surface.normals).sum_dim(0).squeeze_dim(0);
    ((interior(alpha) - agreement) * surface.valid.float()).mean()
}
