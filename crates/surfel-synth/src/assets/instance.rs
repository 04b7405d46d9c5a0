//! A mesh standing in the world: where rays meet it and what light sees there.
//!
//! Rays go to the mesh, never the mesh to the world, so one loaded mesh serves any number of scenes.
//! Invariant: ray parameters are the same in both frames.

use super::mesh::{MeshHit, TexturedMesh};
use super::texels::Texels;
use crate::shape::Ray;
use crate::texture::{Texture, linear_from_srgb};
use glam::{DVec3, Vec2, Vec3};
use std::sync::Arc;
use surfel_core::Similarity;

/// A mesh in the world.
pub struct Instance {
    /// The mesh.
    pub mesh: Arc<TexturedMesh>,
    /// Where it stands and how large it is.
    pub world_from_mesh: Similarity,
    /// Its colour.
    pub paint: Paint,
    /// Strength of the highlight, 0 (matt) to about 0.3.
    pub gloss: f32,
    /// Blinn-Phong exponent of the highlight.
    pub shininess: f32,
}

/// Where an instance takes its colour from.
pub enum Paint {
    /// The mesh's own materials.
    Own,
    /// An image wrapped around along the three axes of the mesh, repeating per mesh radius.
    Wrapped {
        /// The image.
        image: Arc<Texels>,
        /// Repeats per mesh radius.
        repeats: f32,
    },
    /// A procedural texture in mesh coordinates (radius 1).
    Procedural(Texture),
}

/// What light needs to know of a surface point.
pub(super) struct Finish {
    /// Linear colour.
    pub albedo: Vec3,
    /// Unit shading normal towards the eye, world frame.
    pub normal: Vec3,
    /// Share of the surrounding light that reaches the point.
    pub openness: f32,
    /// Strength of the highlight.
    pub gloss: f32,
    /// Blinn-Phong exponent.
    pub shininess: f32,
}

/// Openness assumed on the inner side of an open sheet, where none was measured.
const INSIDE_OPENNESS: f32 = 0.8;

impl Instance {
    /// A ray in the mesh frame; parameters stay the same.
    fn ray_in_mesh(&self, ray: &Ray) -> Ray {
        let to_mesh = self.world_from_mesh.inverse();
        Ray { origin: to_mesh.transform(ray.origin), direction: to_mesh.rotation * ray.direction * to_mesh.scale }
    }

    /// False when the ray misses the sphere that holds the mesh, or enters it beyond `t_max`.
    fn may_meet(&self, ray: &Ray, t_max: f64) -> bool {
        let offset = self.world_from_mesh.translation - ray.origin;
        let along = offset.dot(ray.direction) / ray.direction.length_squared();
        let radius = self.world_from_mesh.scale;
        let reach = radius / ray.direction.length();
        (offset - ray.direction * along).length_squared() <= radius * radius
            && along - reach < t_max
            && along + reach > 0.0
    }

    /// First hit of a world ray nearer than `t_max`, to `f32` precision.
    pub fn intersect(&self, ray: &Ray, t_max: f64) -> Option<MeshHit> {
        if !self.may_meet(ray, t_max) {
            return None;
        }
        let local = self.ray_in_mesh(ray);
        self.mesh.intersect(local.origin.as_vec3(), local.direction.as_vec3(), 0.0, t_max as f32)
    }

    /// True when the mesh stands on a ray before `reach` (in lengths of its direction).
    pub fn blocks(&self, ray: &Ray, reach: f64) -> bool {
        if !self.may_meet(ray, reach) {
            return false;
        }
        let local = self.ray_in_mesh(ray);
        self.mesh.occludes(local.origin.as_vec3(), local.direction.as_vec3(), 0.0, reach as f32)
    }

    /// The exact parameter and world normal on the plane of a triangle.
    pub(super) fn refine(&self, ray: &Ray, hit: MeshHit) -> (f64, DVec3) {
        let [a, b, c] =
            self.mesh.positions(hit.triangle as usize).map(|p| self.world_from_mesh.transform(p.as_dvec3()));
        let normal = (b - a).cross(c - a).normalize_or(DVec3::Z);
        let t = normal.dot(a - ray.origin) / normal.dot(ray.direction);
        // Seen edge-on, the plane says nothing; the traversal's own parameter is the better one.
        let near = (t - f64::from(hit.t)).abs() <= 1e-3 * f64::from(hit.t);
        (if near { t } else { f64::from(hit.t) }, normal)
    }

    /// What light sees at a point on `triangle`: `pixel` is the width of a pixel there, `facing` the geometric
    /// normal towards the eye (world frame).
    pub(super) fn finish(&self, triangle: u32, point: DVec3, pixel: f64, facing: Vec3) -> Finish {
        let to_mesh = self.world_from_mesh.inverse();
        let local = to_mesh.transform(point).as_vec3();
        let footprint = (pixel * to_mesh.scale) as f32;
        let surface = self.mesh.surface(triangle, local, footprint);
        let albedo = match &self.paint {
            Paint::Own => surface.albedo,
            Paint::Wrapped { image, repeats } => {
                let lod = (repeats * image.size().max_element() * footprint).log2();
                triplanar(image, local * *repeats, surface.smooth_normal, lod)
            }
            Paint::Procedural(texture) => Vec3::from(texture.colour(local.as_dvec3()).to_array().map(linear_from_srgb)),
        };
        let in_world = |normal: Vec3| (self.world_from_mesh.rotation * normal.as_dvec3()).as_vec3();
        // The mesh's outside may be the far side of an open sheet; light falls on the side that is seen.
        let is_inside = in_world(surface.normal).dot(facing) < 0.0;
        let smooth = in_world(surface.smooth_normal);
        let (normal, openness) = if is_inside { (-smooth, INSIDE_OPENNESS) } else { (smooth, surface.openness) };
        Finish { albedo, normal, openness, gloss: self.gloss, shininess: self.shininess }
    }
}

/// An image projected along the three axes, blended by the normal.
fn triplanar(image: &Texels, p: Vec3, normal: Vec3, lod: f32) -> Vec3 {
    let weights = normal.abs().powf(6.0);
    let total = weights.element_sum();
    let planes = [Vec2::new(p.y, -p.z), Vec2::new(p.x, -p.z), Vec2::new(p.x, p.y)];
    let parts = weights.to_array().into_iter().zip(planes);
    parts.filter(|(w, _)| *w > 0.02 * total).map(|(w, uv)| image.sample(uv, lod) * (w / total)).sum()
}
