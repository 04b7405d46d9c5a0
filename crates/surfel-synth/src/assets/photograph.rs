//! Photographs a stage: one exact ray per pixel, more colour rays only where one is not enough.
//!
//! Textures are filtered by the pixel's footprint, so inside a surface one ray has the colour; along
//! silhouettes, creases and shadows-to-be of depth edges a 4 x 4 pattern is shot. Invariant: depth, normal
//! and object never depend on that choice.

use super::stage::{Part, Stage, StageHit};
use crate::random::hash;
use crate::render::{NOTHING, Pixel, RenderedView, SURROUNDINGS, assemble, pixel_ray};
use glam::{DVec2, Vec3};
use rayon::prelude::*;
use surfel_core::{Camera, Grid};

/// Colour rays along each axis of a pixel on an edge.
const EDGE_RAYS: usize = 3;

/// Photographs `stage`: linear colour, exact depth, normal and object.
pub fn photograph(stage: &Stage, camera: &Camera, name: &str) -> RenderedView {
    let (width, height) = (camera.width, camera.height);
    let centre = |x: usize, y: usize| pixel_ray(camera, Camera::pixel_centre(x, y));
    let hits: Vec<Option<StageHit>> =
        (0..width * height).into_par_iter().map(|i| stage.trace(&centre(i % width, i / width))).collect();
    let hits = Grid::from_vec(width, height, hits);
    let footprint = 1.0 / camera.intrinsics.mean_focal();
    assemble(name.to_owned(), camera, |x, y| {
        let hit = hits[(x, y)].as_ref();
        // Turning the lamp's sample pattern from pixel to pixel trades banding in penumbrae for fine grain.
        let turn =
            |i: usize| hash((y * width + x) as u64 * 16 + i as u64) as f32 * (std::f32::consts::TAU / u64::MAX as f32);
        let light = if is_edge(&hits, x, y) {
            let rays = EDGE_RAYS * EDGE_RAYS;
            let shoot = |i: usize| {
                let offset = DVec2::new((i % EDGE_RAYS) as f64 + 0.5, (i / EDGE_RAYS) as f64 + 0.5) / EDGE_RAYS as f64;
                let ray = pixel_ray(camera, DVec2::new(x as f64, y as f64) + offset);
                stage.radiance(&ray, stage.trace(&ray).as_ref(), footprint, turn(i))
            };
            (0..rays).map(shoot).sum::<Vec3>() / rays as f32
        } else {
            stage.radiance(&centre(x, y), hit, footprint, turn(0))
        };
        let colour = light.to_array();
        match hit {
            None => Pixel { colour, depth: 0.0, normal: [0.0; 3], object: NOTHING },
            Some(hit) => Pixel {
                colour,
                depth: hit.t as f32,
                normal: (camera.camera_from_world.rotation * hit.normal).as_vec3().to_array(),
                object: match hit.part {
                    Part::Panel(_) => SURROUNDINGS,
                    Part::Instance(i, _) => (i + 1).min(SURROUNDINGS as usize - 1) as u8,
                },
            },
        }
    })
}

/// True when a neighbour sees another part, another distance or another slope.
fn is_edge(hits: &Grid<Option<StageHit>>, x: usize, y: usize) -> bool {
    let here = hits[(x, y)].as_ref();
    let (x, y) = (x as isize, y as isize);
    [(1, 0), (-1, 0), (0, 1), (0, -1)].iter().filter_map(|(dx, dy)| hits.get(x + dx, y + dy)).any(|other| {
        match (here, other) {
            (None, None) => false,
            (Some(a), Some(b)) => {
                let same = match (a.part, b.part) {
                    (Part::Panel(i), Part::Panel(j)) => i == j,
                    (Part::Instance(i, _), Part::Instance(j, _)) => i == j,
                    _ => false,
                };
                !same || (a.t - b.t).abs() > 0.01 * a.t || a.normal.dot(b.normal) < 0.8
            }
            _ => true,
        }
    })
}
