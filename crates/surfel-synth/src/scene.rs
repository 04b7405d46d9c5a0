//! An analytic scene: placed shapes with paint, under simple light.
//!
//! Invariant: light is Lambertian and the same for every view, so a surface point has one colour, and
//! photo-consistency holds exactly (the warp test measures it).

use crate::render::SURROUNDINGS;
use crate::shape::{Ray, Shape};
use crate::texture::{Texture, TextureSpace, linear_from_srgb};
use glam::{DVec3, Vec3};
use surfel_core::Rigid;

/// A shape in the world with its paint.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// The shape, in its own frame.
    pub shape: Shape,
    /// Where it stands.
    pub world_from_shape: Rigid,
    /// Its paint.
    pub texture: Texture,
    /// Which coordinates the paint reads.
    pub texture_space: TextureSpace,
    /// True for ground, tables and walls: there, but not what is to be reconstructed.
    pub is_surroundings: bool,
}

impl Object {
    /// An object at `centre`, axes along the world's.
    pub fn at(centre: DVec3, shape: Shape, texture: Texture) -> Self {
        let world_from_shape = Rigid { translation: centre, ..Rigid::IDENTITY };
        Self { shape, world_from_shape, texture, texture_space: TextureSpace::Surface, is_surroundings: false }
    }

    /// The same object counted among the surroundings.
    pub fn surroundings(self) -> Self {
        Self { is_surroundings: true, ..self }
    }

    /// The ray in the frame of the shape; parameters stay the same.
    pub fn ray_in_shape(&self, ray: &Ray) -> Ray {
        let shape_from_world = self.world_from_shape.inverse();
        Ray { origin: shape_from_world.transform(ray.origin), direction: shape_from_world.rotation * ray.direction }
    }
}

/// Ambient light plus one far lamp; intensities multiply linear albedo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lighting {
    /// Light from everywhere.
    pub ambient: f32,
    /// Light from the lamp on a surface facing it.
    pub key: f32,
    /// Unit direction towards the lamp, world frame.
    pub key_direction: DVec3,
    /// Whether the lamp casts (hard) shadows.
    pub shadows: bool,
}

impl Default for Lighting {
    fn default() -> Self {
        let key_direction = DVec3::new(-0.45, -0.55, 0.7).normalize();
        Self { ambient: 0.45, key: 0.65, key_direction, shadows: true }
    }
}

/// Objects under light.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The objects; surroundings may stand anywhere in the list.
    pub objects: Vec<Object>,
    /// The light.
    pub lighting: Lighting,
    /// sRGB colour where rays meet nothing.
    pub backdrop: [f32; 3],
}

/// Where a ray meets a scene.
#[derive(Clone, Copy, Debug)]
pub struct SceneHit {
    /// Ray parameter; the z-depth for camera rays.
    pub t: f64,
    /// Outward unit normal, world frame.
    pub normal: DVec3,
    /// Index into [`Scene::objects`].
    pub object: usize,
}

impl Scene {
    /// First intersection with `t > t_min`.
    pub fn trace(&self, ray: &Ray, t_min: f64) -> Option<SceneHit> {
        let hits = self.objects.iter().enumerate().filter_map(|(object, placed)| {
            let hit = placed.shape.intersect(&placed.ray_in_shape(ray), t_min)?;
            Some(SceneHit { t: hit.t, normal: placed.world_from_shape.rotation * hit.normal, object })
        });
        hits.min_by(|a, b| a.t.total_cmp(&b.t))
    }

    /// Linear light that arrives along a ray, per channel.
    pub fn radiance(&self, ray: &Ray) -> Vec3 {
        match self.trace(ray, 0.0) {
            Some(hit) => self.albedo(hit.object, ray.at(hit.t)) * self.irradiance(ray, &hit),
            None => self.backdrop_light(),
        }
    }

    /// Linear albedo of the object at `index` at a world point.
    pub fn albedo(&self, index: usize, point: DVec3) -> Vec3 {
        let object = &self.objects[index];
        let texture_point = match object.texture_space {
            TextureSpace::World => point,
            TextureSpace::Surface => object.world_from_shape.inverse().transform(point),
        };
        Vec3::from(object.texture.colour(texture_point).to_array().map(linear_from_srgb))
    }

    /// Light on the side of a surface that a ray hit, as a factor on its albedo.
    pub fn irradiance(&self, ray: &Ray, hit: &SceneHit) -> f32 {
        self.lighting.ambient + self.key_light(ray.at(hit.t), facing(hit.normal, ray))
    }

    /// Linear light where rays meet nothing.
    pub fn backdrop_light(&self) -> Vec3 {
        Vec3::from(self.backdrop.map(linear_from_srgb))
    }

    /// The number written into object maps for the object at `index`.
    pub fn object_id(&self, index: usize) -> u8 {
        if self.objects[index].is_surroundings {
            return SURROUNDINGS;
        }
        let before = self.objects[..index].iter().filter(|object| !object.is_surroundings).count();
        (before + 1).min(SURROUNDINGS as usize - 1) as u8
    }

    fn key_light(&self, point: DVec3, normal: DVec3) -> f32 {
        let Lighting { key, key_direction, shadows, .. } = self.lighting;
        let cosine = normal.dot(key_direction);
        if cosine <= 0.0 {
            return 0.0;
        }
        // Leaving along the normal keeps a surface from shadowing itself.
        let lift = 1e-6 * (1.0 + point.length());
        let to_lamp = Ray { origin: point + normal * lift, direction: key_direction };
        if shadows && self.trace(&to_lamp, lift).is_some() { 0.0 } else { key * cosine as f32 }
    }
}

/// A normal turned towards where the ray comes from.
pub(crate) fn facing(normal: DVec3, ray: &Ray) -> DVec3 {
    if normal.dot(ray.direction) > 0.0 { -normal } else { normal }
}
