//! The Nyquist part: how finely the views sample a surfel, and which pixels see it.
//!
//! Runs between the two head passes, on values without gradients (spec 2.7.3, 1.9). Invariant: nothing here
//! depends on the scene unit.

pub mod adapt;
pub mod region;

use glam::{DVec2, DVec3};
use surfel_core::Camera;

/// Surfels as flat values in the order of [`crate::SurfelTensors`], world frame, scene units.
#[derive(Clone, Debug, Default)]
pub struct Shapes {
    /// Centres.
    pub centres: Vec<[f32; 3]>,
    /// Standard deviations along the two tangents.
    pub scales: Vec<[f32; 2]>,
    /// `world_from_surfel` quaternions w x y z.
    pub rotations: Vec<[f32; 4]>,
}

/// Depths nearer than this fraction of the range's near end are not seen.
pub(crate) const NEAR_CLIP: f64 = 1e-3;

/// True when a world point projects into the image enlarged on each side by `margin` times its size.
fn is_near_image(camera: &Camera, point: DVec3, near_clip: f64, margin: f64) -> Option<f64> {
    let (pixel, z) = camera.project(point)?;
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    let (low, high) = (-size * margin, size * (1.0 + margin));
    (z > near_clip && pixel.cmpge(low).all() && pixel.cmple(high).all()).then_some(z)
}
