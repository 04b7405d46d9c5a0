//! Puts objects on a plane: how they lie, how large they are, what they are painted with.
//!
//! No physics: an object rests on its lowest vertex, and footprints (circles) do not overlap. Invariant:
//! no vertex of a placed object lies below the plane z = 0.

use super::error::AssetError;
use super::instance::{Instance, Paint};
use super::library::AssetLibrary;
use super::mesh::TexturedMesh;
use crate::random::Random;
use crate::texture::Texture;
use glam::{DMat3, DQuat, DVec2, DVec3};
use std::sync::Arc;
use surfel_core::Similarity;

/// A mesh turned and sized, before it has a place.
pub(super) struct Resting {
    pub mesh: Arc<TexturedMesh>,
    rotation: DMat3,
    scale: f64,
    /// Height of the mesh origin above the plane.
    rise: f64,
    /// Height of the highest vertex above the plane.
    pub height: f64,
    /// Radius of a vertical cylinder about the mesh origin that holds it.
    pub footprint: f64,
}

impl Resting {
    /// Upright with a random heading, or any way up when `tumbled`; `scale` is its radius.
    pub fn new(mesh: Arc<TexturedMesh>, scale: f64, tumbled: bool, random: &mut Random) -> Self {
        let heading = DQuat::from_rotation_z(random.range(0.0, std::f64::consts::TAU));
        let turn = if tumbled { DQuat::from_rotation_arc(DVec3::Z, random.direction()) * heading } else { heading };
        let rotation = DMat3::from_quat(turn);
        let placed = mesh.vertices.iter().map(|v| rotation * v.as_dvec3() * scale);
        let (mut low, mut high, mut footprint_sq) = (0.0f64, 0.0f64, 0.0f64);
        for p in placed {
            low = low.min(p.z);
            high = high.max(p.z);
            footprint_sq = footprint_sq.max(p.truncate().length_squared());
        }
        Self { mesh, rotation, scale, rise: -low, height: high - low, footprint: footprint_sq.sqrt() }
    }

    /// Stands the object at `place` on the plane `z = ground`, everything magnified by `factor`.
    pub fn stand(self, place: DVec2, ground: f64, factor: f64, paint: Paint, random: &mut Random) -> Instance {
        let translation = (place.extend(self.rise) * factor) + DVec3::Z * ground;
        let is_glossy = random.chance(0.5);
        Instance {
            mesh: self.mesh,
            world_from_mesh: Similarity { scale: self.scale * factor, rotation: self.rotation, translation },
            paint,
            gloss: if is_glossy { random.range(0.02, 0.08) as f32 } else { 0.0 },
            shininess: random.range(12.0, 90.0) as f32,
        }
    }
}

/// Places for circles of the given radii: each as near to the first as a few dozen random tries allow.
pub(super) fn cluster(radii: &[f64], random: &mut Random) -> Vec<DVec2> {
    let mut places: Vec<DVec2> = Vec::new();
    for (i, radius) in radii.iter().enumerate() {
        let reach: f64 = 2.0 * radii[..=i].iter().sum::<f64>();
        let mut best = (f64::INFINITY, DVec2::ZERO);
        for _ in 0..if i == 0 { 0 } else { 60 } {
            let candidate = DVec2::from_angle(random.range(0.0, std::f64::consts::TAU)) * random.range(0.0, reach);
            let is_free = places.iter().zip(radii).all(|(p, r)| p.distance(candidate) > 0.9 * (r + radius));
            if is_free && candidate.length() < best.0 {
                best = (candidate.length(), candidate);
            }
        }
        // Beyond everything else there is always room.
        places.push(if best.0.is_finite() || i == 0 { best.1 } else { DVec2::X * reach });
    }
    places
}

/// The mesh's own colours, or with probability `share` (always when it has none) something else.
pub(super) fn choose_paint(
    library: &AssetLibrary,
    mesh: &TexturedMesh,
    share: f64,
    random: &mut Random,
) -> Result<Paint, AssetError> {
    if mesh.is_textured && !random.chance(share) {
        return Ok(Paint::Own);
    }
    let kind = random.unit();
    let (files, repeats) = if kind < 0.4 {
        (library.materials(), random.range(0.5, 1.5))
    } else if kind < 0.65 {
        (library.photos(), random.range(0.4, 0.8))
    } else if kind < 0.75 {
        (library.patterns(), random.range(0.4, 1.0))
    } else {
        let mut colour = |low: f64, high: f64| std::array::from_fn(|_| random.range(low, high) as f32);
        let colours = [colour(0.1, 0.5), colour(0.4, 0.95)];
        let size = random.range(0.15, 0.6);
        return Ok(Paint::Procedural(Texture::Noise { seed: random.bits(), size, octaves: 6, colours }));
    };
    let image = library.image(&files[random.below(files.len())])?;
    Ok(Paint::Wrapped { image, repeats: repeats as f32 })
}
