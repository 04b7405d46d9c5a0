//! The mirror: a scene seen in one is a scene, so every sample is two (spec 4.6).
//!
//! Every view is flipped left to right and the world with it: `camera_from_world` becomes `S camera_from_world S` with
//! `S = diag(-1, 1, 1)`, the principal point moves to the other side, normals change the sign of their x. Invariant:
//! mirroring twice gives the scene back, and points land where their mirror images do.

use crate::{TrainingScene, TrainingView};
use surfel_core::Grid;
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
        image: view.image.flipped(),
        camera: view.camera.mirrored(),
        depth: view.depth.as_ref().map(Grid::flipped),
        normal: view.normal.as_ref().map(|map| map.flipped().map(|[x, y, z]| [-x, *y, *z])),
        mask: view.mask.as_ref().map(Grid::flipped),
    }
}
