//! The silhouette term: alpha is one on the object and zero off it (spec 2.8, 4.3).
//!
//! Invariant: finite whatever alpha is.

use burn::tensor::Tensor;

/// Transmittance at which the rasterizer stops: alpha is not known more finely than this.
const FINEST: f64 = 1e-4;

/// Mean binary cross-entropy of `alpha` against `mask`, both `[height, width]` in \[0, 1\], natural logarithm.
///
/// # Panics
/// If the maps differ in size (a programmer's error).
pub fn silhouette(alpha: Tensor<2>, mask: Tensor<2>) -> Tensor<1> {
    let alpha = alpha.clamp(FINEST, 1.0 - FINEST);
    let complement = |map: &Tensor<2>| -map.clone() + 1.0;
    let off = complement(&mask) * complement(&alpha).log();
    -(mask * alpha.log() + off).mean()
}
