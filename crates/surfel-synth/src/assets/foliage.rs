//! Bushes and trees: clouds of leaves, each a flat piece somewhere in a ball, some on a trunk.
//!
//! Millimetres. What no smooth surface describes and every outdoor photograph shows. Invariant: the leaves are the
//! geometry; nothing is drawn on transparent pictures.

use super::instance::{Instance, Paint};
use super::masonry::{Masonry, Side};
use crate::random::Random;
use crate::texture::Texture;
use glam::{DVec2, DVec3};

/// Leaves of the largest crown.
const MOST_LEAVES: usize = 2500;

/// A bush, or a tree when it has a trunk.
pub(super) struct Plant {
    /// Half axes of the crown.
    crown: DVec3,
    /// Height of the crown's lower end.
    trunk: f64,
    /// Edge of a leaf.
    leaf: f64,
}

impl Plant {
    /// Some plant.
    pub fn draw(random: &mut Random) -> Self {
        let radius = random.range(400.0, 2200.0);
        let crown = DVec3::new(1.0, random.range(0.7, 1.3), random.range(0.7, 1.4)) * radius;
        let trunk = if random.chance(0.4) { random.range(1000.0, 3000.0) } else { 0.0 };
        Self { crown, trunk, leaf: random.range(0.05, 0.12) * radius }
    }

    /// Radius of a circle on the ground that it fills.
    pub fn reach(&self) -> f64 {
        self.crown.x.max(self.crown.y)
    }

    /// Plants it.
    pub fn stand(&self, place: DVec2, random: &mut Random) -> Vec<Instance> {
        let middle = DVec3::Z * (self.trunk + self.crown.z);
        let mut leaves = Masonry::default();
        for _ in 0..random.below(MOST_LEAVES / 2) + MOST_LEAVES / 2 {
            // Most leaves grow near the outside, where the light is.
            let from_middle = random.direction() * random.unit().powf(0.25);
            let centre = middle + from_middle * self.crown;
            let (u, v) = random.direction().any_orthonormal_pair();
            let [u, v] = [u * (0.5 * self.leaf), v * (0.5 * self.leaf * random.range(0.4, 1.0))];
            leaves.quad([centre - u - v, centre + u - v, centre + u + v, centre - u + v].map(|p: DVec3| p.as_vec3()));
        }
        let mut trunk = Masonry::default();
        if self.trunk > 0.0 {
            let half = 0.06 * self.crown.x as f32;
            trunk.block(&Side::FRONT, [-half, half], [-half, half], [0.0, middle.z as f32]);
        }
        let hue = random.range(0.3, 1.0);
        let green = |level: f64| [level * hue, level, 0.4 * level].map(|v| v as f32);
        let greens = [green(random.range(0.1, 0.25)), green(random.range(0.3, 0.7))];
        let mut paint = |colours: [[f32; 3]; 2]| {
            let seed = random.bits();
            move |radius| Paint::Procedural(Texture::Noise { seed, size: 400.0 / radius, octaves: 3, colours })
        };
        let bark = [[0.12, 0.1, 0.07], [0.4, 0.33, 0.25]];
        let (on_leaves, on_trunk) = (paint(greens), paint(bark));
        [leaves.stand(place, 0.0, on_leaves), trunk.stand(place, 0.0, on_trunk)].into_iter().flatten().collect()
    }
}
