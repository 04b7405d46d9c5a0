//! What the mesher takes: depth maps with their cameras and colours.
//!
//! Borrowed, because the maps belong to whoever rendered or predicted them.

use crate::MeshError;
use surfel_core::{Camera, Grid};

/// One depth map to fuse. All grids have the size of `camera`.
#[derive(Clone, Copy, Debug)]
pub struct DepthView<'a> {
    /// The camera of all grids.
    pub camera: &'a Camera,
    /// z-depth, scene units; anything not finite or not positive means "no depth".
    pub depth: &'a Grid<f32>,
    /// sRGB values in \[0, 1\].
    pub colour: &'a Grid<[f32; 3]>,
    /// Relative confidence, any positive scale shared by the views; anything not finite or not positive
    /// removes the pixel. `None` is 1 everywhere.
    pub weight: Option<&'a Grid<f32>>,
}

impl DepthView<'_> {
    /// Checks sizes and camera of view number `view`.
    ///
    /// # Errors
    /// [`MeshError::SizeMismatch`] or [`MeshError::BadCamera`].
    pub(crate) fn check(&self, view: usize) -> Result<(), MeshError> {
        let (camera_width, camera_height) = (self.camera.width, self.camera.height);
        let sizes = [
            ("depth", (self.depth.width(), self.depth.height())),
            ("colour", (self.colour.width(), self.colour.height())),
            ("weight", self.weight.map_or((camera_width, camera_height), |w| (w.width(), w.height()))),
        ];
        for (map, (width, height)) in sizes {
            if (width, height) != (camera_width, camera_height) {
                return Err(MeshError::SizeMismatch { view, map, width, height, camera_width, camera_height });
            }
        }
        let (k, pose) = (&self.camera.intrinsics, &self.camera.camera_from_world);
        let focal = |f: f64| f.is_finite() && f > 0.0;
        let finite = k.cx.is_finite() && k.cy.is_finite() && pose.rotation.is_finite() && pose.translation.is_finite();
        if focal(k.fx) && focal(k.fy) && finite { Ok(()) } else { Err(MeshError::BadCamera { view }) }
    }

    /// Depth of pixel number `index` if it is usable.
    pub(crate) fn depth_at(&self, index: usize) -> Option<f64> {
        let depth = self.depth.as_slice()[index];
        let weight = self.weight.map_or(1.0, |w| w.as_slice()[index]);
        (is_depth(depth) && is_depth(weight)).then_some(f64::from(depth))
    }
}

/// True for a usable depth (or weight): finite and positive.
pub(crate) fn is_depth(value: f32) -> bool {
    value.is_finite() && value > 0.0
}
