//! Per-surfel setup in f64: where a surfel stands before the camera and which way it faces (spec 3.2, 3.3).
//!
//! Shared by the fast path, its backward pass and the twin. Invariant: a surfel with any number that is not
//! finite, without direction or extent, or not in front of the camera is `None`; nothing here panics.

use crate::config::{MIN_ALPHA, RenderConfig};
use crate::pixel_camera::PixelCamera;
use crate::quaternion;
use crate::ray_splat::{Footprint, SplatTransform};
use crate::slices::SurfelShape;
use glam::{DMat3, DVec3};

/// A surfel as the camera sees it, with what its gradient needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Projected {
    /// Splat transform and low-pass centre, image index coordinates.
    pub footprint: Footprint,
    /// z-depth of the centre, the sorting key.
    pub z: f64,
    /// Unit normal, camera frame, towards the camera.
    pub normal: DVec3,
    /// `+1` when the normal is `t_w`, `-1` when it is `-t_w`.
    pub facing: f64,
    /// Columns `t_u, t_v, t_w`.
    pub world_from_surfel: DMat3,
    /// Normalised quaternion.
    pub unit_rotation: [f64; 4],
    /// Length the quaternion had.
    pub rotation_length: f64,
    /// Unit vector from the camera centre to the surfel, world frame.
    pub direction: DVec3,
    /// Distance from the camera centre to the surfel.
    pub distance: f64,
}

impl Projected {
    /// z-depth as sorted: both renderers order by the f32 value, ties by index.
    pub fn depth_key(&self) -> f32 {
        self.z as f32
    }
}

pub(crate) fn project(camera: &PixelCamera, config: &RenderConfig, shape: &SurfelShape) -> Option<Projected> {
    let usable = shape.centre.is_finite()
        && shape.scales.is_finite()
        && shape.scales.min_element() > 0.0
        && shape.opacity.is_finite()
        && shape.opacity >= MIN_ALPHA;
    if !usable {
        return None;
    }
    let centre = camera.camera_from_world.transform(shape.centre);
    if !(centre.z > config.near_clip && centre.is_finite()) {
        return None;
    }
    let (unit_rotation, rotation_length) = quaternion::normalise(shape.rotation)?;
    let world_from_surfel = quaternion::to_matrix(unit_rotation);
    let normal = camera.camera_from_world.rotation * world_from_surfel.z_axis;
    let towards_camera = -centre.dot(normal);
    if towards_camera == 0.0 || !towards_camera.is_finite() {
        return None;
    }
    let facing = towards_camera.signum();
    let transform = SplatTransform::new(camera, &world_from_surfel, shape.scales, centre);
    let footprint = Footprint::new(transform, config.cutoff)?;
    let offset = shape.centre - camera.centre;
    let distance = offset.length();
    Some(Projected {
        footprint,
        z: centre.z,
        normal: normal * facing,
        facing,
        world_from_surfel,
        unit_rotation,
        rotation_length,
        direction: offset / distance,
        distance,
    })
}
