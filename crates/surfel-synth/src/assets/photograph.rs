//! Photographs a stage: one exact ray per pixel, more colour rays only where one is not enough.
//!
//! Textures are filtered by the pixel's footprint, so inside a surface one ray has the colour; along
//! silhouettes and creases a 3 x 3 pattern is shot. Invariant: depth, normal and object never depend on
//! that choice.

use super::stage::{Part, Stage, StageHit};
use crate::random::hash;
use crate::render::{
    NOTHING, Pixel, RenderedView, SURROUNDINGS, assemble, is_edge, parallel_grid, pixel_ray, subpixel_ray,
};
use glam::Vec3;
use std::f32::consts::TAU;
use surfel_core::Camera;

/// Colour rays along each axis of a pixel on an edge.
const EDGE_RAYS: usize = 3;

/// Photographs `stage`: linear colour, exact depth, normal and object.
pub fn photograph(stage: &Stage, camera: &Camera, name: &str) -> RenderedView {
    let centre = |x: usize, y: usize| pixel_ray(camera, Camera::pixel_centre(x, y));
    let hits = parallel_grid(camera, |x, y| stage.trace(&centre(x, y)));
    let footprint = 1.0 / camera.intrinsics.mean_focal();
    let pixels = parallel_grid(camera, |x, y| {
        let hit = hits[(x, y)].as_ref();
        // Turning the lamp's sample pattern from pixel to pixel trades banding in penumbrae for fine grain.
        let turn = |i: usize| {
            let key = (y * camera.width + x) * EDGE_RAYS * EDGE_RAYS + i;
            hash(key as u64) as f32 / u64::MAX as f32 * TAU
        };
        let light = if is_edge(&hits, x, y, differ) {
            let rays = EDGE_RAYS * EDGE_RAYS;
            let shoot = |i: usize| {
                let ray = subpixel_ray(camera, x, y, i, EDGE_RAYS);
                stage.radiance(&ray, stage.trace(&ray).as_ref(), footprint, turn(i))
            };
            (0..rays).map(shoot).sum::<Vec3>() / rays as f32
        } else {
            stage.radiance(&centre(x, y), hit, footprint, turn(0))
        };
        let colour = light.to_array();
        let Some(hit) = hit else {
            return Pixel { colour, depth: 0.0, normal: [0.0; 3], object: NOTHING };
        };
        let normal = (camera.camera_from_world.rotation * hit.normal).as_vec3().to_array();
        let object = match hit.part {
            Part::Panel(_) => SURROUNDINGS,
            Part::Instance(i, _) => (i + 1).min(SURROUNDINGS as usize - 1) as u8,
        };
        Pixel { colour, depth: hit.t as f32, normal, object }
    });
    assemble(name.to_owned(), camera, &pixels)
}

/// True when two rays met different parts, or the same at another distance or slope.
fn differ(a: &StageHit, b: &StageHit) -> bool {
    let same = match (a.part, b.part) {
        (Part::Panel(i), Part::Panel(j)) => i == j,
        (Part::Instance(i, _), Part::Instance(j, _)) => i == j,
        _ => false,
    };
    !same || (a.t - b.t).abs() > 0.01 * a.t || a.normal.dot(b.normal) < 0.8
}
