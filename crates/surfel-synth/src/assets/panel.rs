//! Flat textured rectangles: tables, floors, walls and posters, with the contact shadows on them.
//!
//! Invariant: panel coordinates run from -1 to 1 between opposite edges, which are perpendicular.

use super::instance::Finish;
use super::texels::Texels;
use crate::shape::Ray;
use glam::{DVec3, Vec2, Vec3};
use std::sync::Arc;

/// A flat rectangle: table, floor, wall or poster.
pub struct Panel {
    /// Middle, world frame, scene units.
    pub centre: DVec3,
    /// From the middle to the edges; perpendicular to each other.
    pub half: [DVec3; 2],
    /// Its image, repeating.
    pub image: Arc<Texels>,
    /// Image repeats along the two edges.
    pub repeats: Vec2,
    /// Linear factor on the image's colour.
    pub tint: Vec3,
    /// How open the panel is to the sky, near objects.
    pub openness: Option<OpennessMap>,
}

/// Ambient occlusion on a square part of a panel.
pub struct OpennessMap {
    /// Number of samples along each side.
    pub size: usize,
    /// Row-major values in \[0, 1\], over the panel's own coordinates -1..1 in both directions.
    pub values: Vec<f32>,
    /// Panel coordinates of the covered part: low and high corner.
    pub bounds: [Vec2; 2],
}

impl Panel {
    /// Unit normal, world frame.
    pub fn normal(&self) -> DVec3 {
        self.half[0].cross(self.half[1]).normalize_or(DVec3::Z)
    }

    /// Ray parameter of the hit, if the ray meets the rectangle from either side.
    pub fn intersect(&self, ray: &Ray) -> Option<f64> {
        let normal = self.half[0].cross(self.half[1]);
        let t = normal.dot(self.centre - ray.origin) / normal.dot(ray.direction);
        let [u, v] = self.coordinates(ray.at(t));
        (t > 0.0 && t.is_finite() && u.abs() <= 1.0 && v.abs() <= 1.0).then_some(t)
    }

    /// Panel coordinates of a world point, -1..1 from edge to edge.
    pub fn coordinates(&self, point: DVec3) -> [f64; 2] {
        self.half.map(|edge| (point - self.centre).dot(edge) / edge.length_squared())
    }

    /// Linear colour at a point on it; `footprint` is the width of a pixel there, scene units.
    pub fn albedo(&self, point: DVec3, footprint: f64) -> Vec3 {
        let [u, v] = self.coordinates(point);
        let uv = Vec2::new(u as f32, v as f32) * 0.5 * self.repeats;
        let texels = self.repeats * self.image.size();
        let lengths = Vec2::new(2.0 * self.half[0].length() as f32, 2.0 * self.half[1].length() as f32);
        let density = (texels / lengths).max_element();
        self.image.sample(uv + 0.5, (density * footprint as f32).log2()) * self.tint
    }

    /// What light sees at a point on it.
    pub(super) fn finish(&self, point: DVec3, pixel: f64, facing: Vec3) -> Finish {
        let [u, v] = self.coordinates(point);
        let openness = self.openness.as_ref().map_or(1.0, |map| map.at(Vec2::new(u as f32, v as f32)));
        Finish { albedo: self.albedo(point, pixel), normal: facing, openness, gloss: 0.0, shininess: 1.0 }
    }
}

impl OpennessMap {
    fn at(&self, coordinates: Vec2) -> f32 {
        let [low, high] = self.bounds;
        let p = (coordinates - low) / (high - low) * (self.size as f32 - 1.0);
        let last = self.size as f32 - 1.0;
        if !(p.x >= 0.0 && p.y >= 0.0 && p.x <= last && p.y <= last) {
            return 1.0;
        }
        let (x, y) = ((p.x as usize).min(self.size - 2), (p.y as usize).min(self.size - 2));
        let (s, t) = (p.x - x as f32, p.y - y as f32);
        let value = |i: usize, j: usize| self.values[(y + j) * self.size + x + i];
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        lerp(lerp(value(0, 0), value(1, 0), s), lerp(value(0, 1), value(1, 1), s), t)
    }
}
