//! The mirror: a scene seen in one is a scene, so every sample is two (spec 4.6).
//!
//! Every view is flipped left to right and the world with it: `camera_from_world` becomes `S camera_from_world S` with
//! `S = diag(-1, 1, 1)`, the principal point moves to the other side, normals change the sign of their x. Invariant:
//! mirroring twice gives the scene back, and points land where their mirror images do.

use crate::{TrainingScene, TrainingView};
use glam::{DMat3, DVec3};
use surfel_core::{Camera, Grid, Rigid};
use surfel_synth::Random;

/// The mirrored scene.
pub fn mirrored(scene: &TrainingScene) -> TrainingScene {
    TrainingScene {
        contexts: scene.contexts.iter().map(mirrored_view).collect(),
        targets: scene.targets.iter().map(mirrored_view).collect(),
        ..scene.clone()
    }
}

/// The scene or its mirror image, with equal chances.
pub fn perhaps_mirrored(scene: TrainingScene, random: &mut Random) -> TrainingScene {
    if random.chance(0.5) { mirrored(&scene) } else { scene }
}

fn mirrored_view(view: &TrainingView) -> TrainingView {
    TrainingView {
        name: view.name.clone(),
        image: flipped(&view.image),
        camera: mirrored_camera(&view.camera),
        depth: view.depth.as_ref().map(flipped),
        normal: view.normal.as_ref().map(|map| flipped(map).map(|[x, y, z]| [-x, *y, *z])),
        mask: view.mask.as_ref().map(flipped),
    }
}

fn flipped<T: Copy>(map: &Grid<T>) -> Grid<T> {
    Grid::from_fn(map.width(), map.height(), |x, y| map[(map.width() - 1 - x, y)])
}

fn mirrored_camera(camera: &Camera) -> Camera {
    let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    let mut mirrored = *camera;
    mirrored.intrinsics.cx = camera.width as f64 - camera.intrinsics.cx;
    mirrored.camera_from_world = Rigid {
        rotation: mirror * camera.camera_from_world.rotation * mirror,
        translation: mirror * camera.camera_from_world.translation,
    };
    mirrored
}
