//! Cameras and points that unit tests of this crate share: two cameras toed in on a lumpy slab.
//!
//! Lengths scale with `unit`; everything else is fixed.

use crate::Match;
use glam::{DMat3, DVec3};
use surfel_core::{Camera, Intrinsics, Rigid};

/// Two cameras 1.2 units apart, 8 units from the origin, both looking at it.
pub(crate) fn toed_in(unit: f64) -> (Camera, Camera) {
    (looking_at_origin(DVec3::new(-0.6, 0.3, -8.0) * unit), looking_at_origin(DVec3::new(0.6, -0.1, -7.8) * unit))
}

/// A 480 x 360 camera that looks from `centre` at the origin, +Y about downwards.
pub(crate) fn looking_at_origin(centre: DVec3) -> Camera {
    let forward = -centre.normalize();
    let right = DVec3::Y.cross(forward).normalize();
    let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    Camera {
        intrinsics: Intrinsics { fx: 500.0, fy: 505.0, cx: 244.0, cy: 177.0 },
        width: 480,
        height: 360,
        camera_from_world: Rigid { rotation, translation: -(rotation * centre) },
    }
}

/// 100 points on a lumpy slab about the origin, z from -1 to 1 units.
pub(crate) fn scene_points(unit: f64) -> Vec<DVec3> {
    let lattice = (0..100).map(|i| DVec3::new((i % 10) as f64 - 4.5, (i / 10) as f64 - 4.5, (i as f64 * 1.7).sin()));
    lattice.map(|p| DVec3::new(0.4 * p.x, 0.3 * p.y, p.z) * unit).collect()
}

/// The exact matches of [`scene_points`].
pub(crate) fn noiseless(a: &Camera, b: &Camera, unit: f64) -> Vec<Match> {
    let pixel = |camera: &Camera, point| camera.project(point).expect("the slab is in front of both cameras").0;
    let points = scene_points(unit);
    points.into_iter().map(|p| Match { a: pixel(a, p), b: pixel(b, p), score: 1.0 }).collect()
}
