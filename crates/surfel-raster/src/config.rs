//! What can be chosen about a rendering, and the checks that keep a bad choice from reaching the pixel loops.
//!
//! Lengths are scene units; for a scale-equivariant model set them from the scene's depth range.

use crate::RasterError;

/// Opacity times Gaussian below which a surfel cannot change an 8-bit pixel and is skipped (spec 3.4).
pub const MIN_ALPHA: f64 = 1.0 / 255.0;

/// Blending never gets fully opaque, so that gradients can pass through the front surfel (spec 3.4).
pub const MAX_ALPHA: f64 = 0.99;

/// A pixel is finished before its transmittance would fall below this (spec 3.4).
pub const MIN_TRANSMITTANCE: f64 = 1e-4;

/// Which pixels a surfel is offered to (spec 3.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BoundingBox {
    /// Every pixel where alpha can reach 1/255: the result does not depend on tiles.
    #[default]
    AlphaAware,
    /// The 16-pixel tiles that a square `cutoff`-sigma box touches, as the reference rasterizer does.
    Reference,
}

/// How to render. `Default` is spec 11.4.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderConfig {
    /// Linear RGB shown where surfels leave transmittance.
    pub background: [f32; 3],
    /// Surfels and hits nearer than this z-depth are skipped, scene units.
    pub near_clip: f64,
    /// Near end of the depth mapping of the distortion map, scene units, > 0.
    pub dist_near: f64,
    /// Far end of the depth mapping of the distortion map, scene units, > `dist_near`.
    pub dist_far: f64,
    /// Standard deviations at which a surfel's box is taken to find its low-pass centre.
    pub cutoff: f64,
    /// Which pixels a surfel is offered to.
    pub bounding_box: BoundingBox,
    /// Where the low-pass wins, report the z-depth of the surfel's centre instead of the ray hit, which runs
    /// away for edge-on surfels. Off reproduces the reference.
    pub centre_depth_when_lowpass: bool,
    /// Reproduce the reference's incomplete gradients (spec 8.2) instead of the exact ones: no zero through
    /// the 0.99 clamp, no depth gradient through (u, v) where the low-pass wins, no quaternion projection.
    pub reference_grad: bool,
}

impl Default for RenderConfig {
    fn default() -> Self {
        Self {
            background: [0.0; 3],
            near_clip: 0.2,
            dist_near: 0.2,
            dist_far: 100.0,
            cutoff: 3.0,
            bounding_box: BoundingBox::AlphaAware,
            centre_depth_when_lowpass: false,
            reference_grad: false,
        }
    }
}

impl RenderConfig {
    /// The default for a scene seen between z-depths `near` and `far` (spec 3.4, last line): clips at a
    /// tenth of `near` and maps the distortion onto the range, so that rendering is scale-equivariant.
    pub fn for_depth_range(near: f64, far: f64) -> Self {
        Self { near_clip: 0.1 * near, dist_near: near, dist_far: far, ..Self::default() }
    }

    /// # Errors
    /// [`RasterError::Config`] naming the first field that makes no sense.
    pub fn validate(&self) -> Result<(), RasterError> {
        let complain = |field, value, expected| Err(RasterError::Config { field, value, expected });
        if !(self.near_clip >= 0.0 && self.near_clip.is_finite()) {
            return complain("near_clip", self.near_clip, "a finite z-depth of at least 0");
        }
        if !(self.dist_near > 0.0 && self.dist_near.is_finite()) {
            return complain("dist_near", self.dist_near, "a finite z-depth above 0");
        }
        if !(self.dist_far > self.dist_near && self.dist_far.is_finite()) {
            return complain("dist_far", self.dist_far, "a finite z-depth beyond dist_near");
        }
        if !(self.cutoff > 0.0 && self.cutoff.is_finite()) {
            return complain("cutoff", self.cutoff, "a number of standard deviations above 0");
        }
        match self.background.iter().find(|c| !c.is_finite()) {
            Some(&bad) => complain("background", f64::from(bad), "finite colour values"),
            None => Ok(()),
        }
    }

    /// `K` of the distortion mapping `m(z) = far/(far-near) (1 - near/z) = const - K/z`.
    pub(crate) fn distortion_factor(&self) -> f64 {
        self.dist_far * self.dist_near / (self.dist_far - self.dist_near)
    }
}
