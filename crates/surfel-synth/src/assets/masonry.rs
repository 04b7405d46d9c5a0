//! Meshes laid from flat pieces: walls, frames, ledges and roofs.
//!
//! Between what a building wants built and the ray caster's meshes. Lengths are the builder's. Invariant: every piece
//! keeps its own corners, so edges stay sharp.

use super::glb::{Glb, Primitive};
use super::instance::{Instance, Paint};
use super::mesh::{Enclosure, TexturedMesh};
use glam::{DMat3, DVec2, DVec3, Vec3};
use std::sync::Arc;
use surfel_core::Similarity;

/// One side of a building, seen from outside: from its lower left corner to the right, outwards and up (+Z).
#[derive(Clone, Copy)]
pub(super) struct Side {
    /// Lower left corner.
    pub corner: Vec3,
    /// Unit vector to the right.
    pub right: Vec3,
    /// Unit vector outwards.
    pub out: Vec3,
}

/// Pieces laid so far.
#[derive(Default)]
pub(super) struct Masonry {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Side {
    /// From the origin along +X, looking towards -Y.
    pub const FRONT: Self = Self { corner: Vec3::ZERO, right: Vec3::X, out: Vec3::NEG_Y };

    /// A point so far to the right, outwards and up.
    pub fn at(&self, right: f32, out: f32, up: f32) -> Vec3 {
        self.corner + self.right * right + self.out * out + Vec3::Z * up
    }
}

impl Masonry {
    /// A flat piece with corners in order.
    pub fn quad(&mut self, corners: [Vec3; 4]) {
        let first = self.positions.len() as u32;
        self.positions.extend(corners.map(|p| p.to_array()));
        self.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }

    /// A flat piece parallel to a side, `out` before it.
    pub fn sheet(&mut self, side: &Side, [left, right]: [f32; 2], [low, high]: [f32; 2], out: f32) {
        if right > left && high > low {
            self.quad([(left, low), (right, low), (right, high), (left, high)].map(|(u, z)| side.at(u, out, z)));
        }
    }

    /// A box whose faces are parallel to a side, `back` to `front` outwards.
    pub fn block(&mut self, side: &Side, along: [f32; 2], [back, front]: [f32; 2], upright: [f32; 2]) {
        self.sheet(side, along, upright, front);
        self.sheet(side, along, upright, back);
        let [[left, right], [low, high]] = [along, upright];
        for u in along {
            self.quad([(back, low), (front, low), (front, high), (back, high)].map(|(out, z)| side.at(u, out, z)));
        }
        for z in upright {
            self.quad([(left, back), (right, back), (right, front), (left, front)].map(|(u, out)| side.at(u, out, z)));
        }
    }

    /// Puts the pieces into the world: turned by `heading` (radians) about the builder's origin, which goes to
    /// `place`. `paint` is given the radius of the mesh. `None` when nothing was laid.
    pub fn stand(self, place: DVec2, heading: f64, paint: impl FnOnce(f64) -> Paint) -> Option<Instance> {
        let Enclosure { middle, radius, .. } = Enclosure::of(self.positions.iter().map(|&p| Vec3::from(p)))?;
        let Self { positions, triangles } = self;
        let base_colour = [1.0; 3];
        let primitive = Primitive { positions, uvs: Vec::new(), triangles, base_colour, image: None, roughness: 1.0 };
        let mesh = TexturedMesh::new(&Glb { primitives: vec![primitive], images: Vec::new() }, &[], false)?;
        let (rotation, scale) = (DMat3::from_rotation_z(heading), f64::from(radius));
        let translation = place.extend(0.0) + rotation * DVec3::from(middle);
        let paint = paint(scale);
        let world_from_mesh = Similarity { scale, rotation, translation };
        Some(Instance { mesh: Arc::new(mesh), world_from_mesh, paint, gloss: 0.0, shininess: 1.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Ray;
    use crate::texture::Texture;

    #[test]
    fn a_block_stands_where_it_was_put() {
        let side = Side { corner: Vec3::new(-1.0, 0.0, 0.0), right: Vec3::X, out: Vec3::NEG_Y };
        let mut masonry = Masonry::default();
        masonry.block(&side, [0.0, 4.0], [-2.0, 0.5], [1.0, 3.0]);
        let plain = |_| Paint::Procedural(Texture::Solid([0.5; 3]));
        // Turned by a right angle, outwards is +X; the front lies 0.5 before the place.
        let instance = masonry.stand(DVec2::new(10.0, 20.0), std::f64::consts::FRAC_PI_2, plain).unwrap();
        let distance = |origin: DVec3, direction: DVec3| {
            let ray = Ray { origin, direction };
            instance.intersect(&ray, f64::INFINITY).map(|hit| instance.refine(&ray, hit).0)
        };
        let near = |found: Option<f64>, wanted: f64| found.is_some_and(|t| (t - wanted).abs() < 1e-5);
        assert!(near(distance(DVec3::new(15.0, 20.0, 2.0), DVec3::NEG_X), 4.5));
        assert!(near(distance(DVec3::new(9.0, 30.0, 2.0), DVec3::NEG_Y), 7.0));
        assert!(near(distance(DVec3::new(9.0, 20.0, 9.0), DVec3::NEG_Z), 6.0));
        assert!(distance(DVec3::new(15.0, 20.0, 0.9), DVec3::NEG_X).is_none());
        assert!(Masonry::default().stand(DVec2::ZERO, 0.0, plain).is_none());
    }
}
