//! The camera in the form the pixel loops want: index coordinates, and checked to be able to project.
//!
//! Invariant: focal lengths are finite and positive, everything else is finite.

use crate::RasterError;
use glam::{DVec2, DVec3};
use surfel_core::{Camera, Rigid};

/// A pinhole camera whose pixel `(i, j)` has its centre at `(i, j)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelCamera {
    /// World to camera, OpenCV axes.
    pub camera_from_world: Rigid,
    /// Camera centre in the world.
    pub centre: DVec3,
    /// Focal lengths, pixels.
    pub focal: DVec2,
    /// Principal point, index coordinates.
    pub principal: DVec2,
    /// Image columns.
    pub width: usize,
    /// Image rows.
    pub height: usize,
}

impl PixelCamera {
    /// # Errors
    /// [`RasterError::Camera`] for a focal length that is not positive or an entry that is not finite.
    pub fn new(camera: &Camera) -> Result<Self, RasterError> {
        let k = &camera.intrinsics;
        let complain = |field, value, expected| Err(RasterError::Camera { field, value, expected });
        for (field, value) in [("focal length fx", k.fx), ("focal length fy", k.fy)] {
            if !(value.is_finite() && value > 0.0) {
                return complain(field, value, "a finite number of pixels above 0");
            }
        }
        let pose = &camera.camera_from_world;
        let entries = [k.cx, k.cy].into_iter().chain(pose.translation.to_array()).chain(pose.rotation.to_cols_array());
        if let Some(bad) = entries.into_iter().find(|entry| !entry.is_finite()) {
            return complain("principal point or pose", bad, "finite");
        }
        const MAX_SIDE: usize = 1 << 20;
        let longest = camera.width.max(camera.height);
        if longest > MAX_SIDE {
            return complain("image side", longest as f64, "at most 1048576 pixels");
        }
        Ok(Self {
            camera_from_world: camera.camera_from_world,
            centre: camera.centre(),
            focal: DVec2::new(k.fx, k.fy),
            principal: k.principal_index(),
            width: camera.width,
            height: camera.height,
        })
    }
}
