//! A scene of textured meshes on flat panels under lamps and an environment: what a ray sees.
//!
//! Invariant: geometry is the triangles and panels alone. Smooth normals, gloss and occlusion change
//! colours; [`Stage::trace`] never looks at them.

use super::light::{Irradiance, Lamp, equirect_uv};
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

/// What rays see that meet nothing.
pub enum Backdrop {
    /// One linear colour.
    Flat(Vec3),
    /// An equirectangular picture turned by an azimuth in turns, times a linear gain.
    Environment(Arc<Texels>, f32, f32),
    /// A picture hung at infinity around a direction, `spread` wide (tangent), times a linear gain.
    Photo {
        /// The picture.
        image: Arc<Texels>,
        /// Unit direction of its middle.
        towards: Vec3,
        /// Half of its width, as a tangent.
        spread: f32,
        /// Linear factor.
        gain: f32,
    },
}

/// Everything a ray can meet, and the light on it.
pub struct Stage {
    /// The objects, numbered from 1 in object maps.
    pub instances: Vec<Instance>,
    /// The surroundings.
    pub panels: Vec<Panel>,
    /// Far lamps.
    pub lamps: Vec<Lamp>,
    /// Light from everywhere.
    pub irradiance: Irradiance,
    /// Linear light that the ground throws back up.
    pub bounce: Vec3,
    /// What lies behind everything.
    pub backdrop: Backdrop,
    /// Size of the scene, scene units; sets how far rays start from the surface they leave.
    pub radius: f64,
}

/// What a ray met.
#[derive(Clone, Copy, Debug)]
pub enum Part {
    /// The instance at an index, at one of its triangles.
    Instance(usize, u32),
    /// The panel at an index.
    Panel(usize),
}

/// Where a ray meets the stage.
#[derive(Clone, Copy, Debug)]
pub struct StageHit {
    /// Ray parameter, from `f64` arithmetic on the triangle that was hit.
    pub t: f64,
    /// Unit geometric normal, world frame, facing the ray's origin.
    pub normal: DVec3,
    /// What was met.
    pub part: Part,
}

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

    /// The exact parameter and world normal on the plane of a triangle.
    fn refine(&self, ray: &Ray, hit: MeshHit) -> (f64, DVec3) {
        let [a, b, c] =
            self.mesh.positions(hit.triangle as usize).map(|p| self.world_from_mesh.transform(p.as_dvec3()));
        let normal = (b - a).cross(c - a).normalize_or(DVec3::Z);
        let t = normal.dot(a - ray.origin) / normal.dot(ray.direction);
        // Seen edge-on, the plane says nothing; the traversal's own parameter is the better one.
        let near = (t - f64::from(hit.t)).abs() <= 1e-3 * f64::from(hit.t);
        (if near { t } else { f64::from(hit.t) }, normal)
    }
}

impl Panel {
    /// Unit normal, world frame.
    pub fn normal(&self) -> DVec3 {
        self.half[0].cross(self.half[1]).normalize_or(DVec3::Z)
    }

    fn intersect(&self, ray: &Ray) -> Option<f64> {
        let normal = self.half[0].cross(self.half[1]);
        let t = normal.dot(self.centre - ray.origin) / normal.dot(ray.direction);
        let [u, v] = self.coordinates(ray.at(t));
        (t > 0.0 && t.is_finite() && u.abs() <= 1.0 && v.abs() <= 1.0).then_some(t)
    }

    /// Panel coordinates of a world point, -1..1 from edge to edge.
    pub fn coordinates(&self, point: DVec3) -> [f64; 2] {
        self.half.map(|edge| (point - self.centre).dot(edge) / edge.length_squared())
    }

    fn albedo(&self, point: DVec3, footprint: f64) -> Vec3 {
        let [u, v] = self.coordinates(point);
        let uv = Vec2::new(u as f32, v as f32) * 0.5 * self.repeats;
        let texels = self.repeats * self.image.size();
        let lengths = Vec2::new(2.0 * self.half[0].length() as f32, 2.0 * self.half[1].length() as f32);
        let density = (texels / lengths).max_element();
        self.image.sample(uv + 0.5, (density * footprint as f32).log2()) * self.tint
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

impl Stage {
    /// First surface along a ray.
    pub fn trace(&self, ray: &Ray) -> Option<StageHit> {
        let mut t_max = f64::INFINITY;
        let mut met = None;
        for (i, panel) in self.panels.iter().enumerate() {
            if let Some(t) = panel.intersect(ray).filter(|&t| t < t_max) {
                t_max = t;
                met = Some((t, panel.normal(), Part::Panel(i)));
            }
        }
        for (i, instance) in self.instances.iter().enumerate() {
            if let Some(hit) = instance.intersect(ray, t_max) {
                let (t, normal) = instance.refine(ray, hit);
                t_max = t;
                met = Some((t, normal, Part::Instance(i, hit.triangle)));
            }
        }
        met.map(|(t, normal, part)| {
            let normal = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
            StageHit { t, normal, part }
        })
    }

    /// True when an object stands between a point and a far lamp, or within `reach` scene units.
    pub fn is_blocked(&self, point: DVec3, direction: Vec3, reach: f64) -> bool {
        let ray = Ray { origin: point, direction: direction.as_dvec3() };
        self.instances.iter().any(|instance| {
            if !instance.may_meet(&ray, reach) {
                return false;
            }
            let local = instance.ray_in_mesh(&ray);
            instance.mesh.occludes(local.origin.as_vec3(), local.direction.as_vec3(), 0.0, reach as f32)
        })
    }

    /// Linear light along a ray that met `hit`; `footprint` is the width of a pixel per unit of the ray.
    pub fn radiance(&self, ray: &Ray, hit: Option<&StageHit>, footprint: f64, turn: f32) -> Vec3 {
        let Some(hit) = hit else { return self.backdrop.radiance(ray.direction.as_vec3()) };
        let point = ray.at(hit.t);
        let facing = hit.normal.as_vec3();
        // Half of the stretching of the footprint at a slant: sharp across, a little blurred along.
        let slant = (-hit.normal.dot(ray.direction.normalize())).max(0.05).sqrt();
        let pixel = footprint * hit.t / slant;
        let (albedo, normal, openness, gloss, shininess) = match hit.part {
            Part::Panel(i) => {
                let panel = &self.panels[i];
                let [u, v] = panel.coordinates(point);
                let openness = panel.openness.as_ref().map_or(1.0, |map| map.at(Vec2::new(u as f32, v as f32)));
                (panel.albedo(point, pixel), facing, openness, 0.0, 1.0)
            }
            Part::Instance(i, triangle) => self.instance_surface(&self.instances[i], triangle, point, pixel, facing),
        };
        let view = -ray.direction.as_vec3().normalize();
        let lifted = point + hit.normal * (1e-4 * self.radius);
        let sky = 0.5 + 0.5 * normal.z;
        let mut light = albedo * self.bounce.lerp(self.irradiance.on(normal), sky) * openness;
        for (i, lamp) in self.lamps.iter().enumerate() {
            let cosine = normal.dot(lamp.direction);
            if cosine <= 0.0 || facing.dot(lamp.direction) <= 0.0 {
                continue;
            }
            let visible = self.visibility(lamp, lifted, turn + i as f32);
            let half = (view + lamp.direction).normalize_or(normal);
            let highlight = gloss * normal.dot(half).max(0.0).powf(shininess) * (shininess + 8.0) / 8.0;
            light += (albedo + highlight) * lamp.colour * (cosine * visible);
        }
        light
    }

    fn instance_surface(
        &self,
        instance: &Instance,
        triangle: u32,
        point: DVec3,
        pixel: f64,
        facing: Vec3,
    ) -> (Vec3, Vec3, f32, f32, f32) {
        let to_mesh = instance.world_from_mesh.inverse();
        let local = to_mesh.transform(point).as_vec3();
        let footprint = (pixel * to_mesh.scale) as f32;
        let surface = instance.mesh.surface(triangle, local, footprint);
        let albedo = match &instance.paint {
            Paint::Own => surface.albedo,
            Paint::Wrapped { image, repeats } => {
                let lod = (repeats * image.size().max_element() * footprint).log2();
                triplanar(image, local * *repeats, surface.smooth_normal, lod)
            }
            Paint::Procedural(texture) => Vec3::from(texture.colour(local.as_dvec3()).to_array().map(linear_from_srgb)),
        };
        let smooth = (instance.world_from_mesh.rotation * surface.smooth_normal.as_dvec3()).as_vec3();
        // The mesh's outside may be the far side of an open sheet; light falls on the side that is seen.
        let outward = (instance.world_from_mesh.rotation * surface.normal.as_dvec3()).as_vec3();
        let (normal, openness) = if outward.dot(facing) < 0.0 { (-smooth, 0.8) } else { (smooth, surface.openness) };
        // Near the ground the lower half of the sky is missing.
        let height = ((point.z - self.ground_height()) / (0.6 * instance.world_from_mesh.scale)).clamp(0.0, 1.0) as f32;
        let downward = 0.5 - 0.5 * normal.z;
        let contact = 1.0 - 0.65 * downward * (1.0 - height);
        (albedo, normal, openness * contact, instance.gloss, instance.shininess)
    }

    fn ground_height(&self) -> f64 {
        self.panels.first().map_or(f64::NEG_INFINITY, |ground| ground.centre.z)
    }

    /// Share of a lamp seen from a point. Four rays decide; only where they disagree are more spent.
    fn visibility(&self, lamp: &Lamp, point: DVec3, turn: f32) -> f32 {
        const PROBES: usize = 4;
        const RAYS: usize = 12;
        let seen =
            |i: usize, count: usize, turn: f32| !self.is_blocked(point, lamp.sample(i, count, turn), f64::INFINITY);
        let open = (0..PROBES).filter(|&i| seen(i, PROBES, turn)).count();
        if open == 0 || open == PROBES {
            return open as f32 / PROBES as f32;
        }
        let more = (0..RAYS).filter(|&i| seen(i, RAYS, turn + 1.0)).count();
        (open + more) as f32 / (PROBES + RAYS) as f32
    }
}

impl Backdrop {
    /// The same backdrop times a linear factor.
    pub fn dimmed(self, factor: f32) -> Self {
        match self {
            Self::Flat(colour) => Self::Flat(colour * factor),
            Self::Environment(image, turn, gain) => Self::Environment(image, turn, gain * factor),
            Self::Photo { image, towards, spread, gain } => Self::Photo { image, towards, spread, gain: gain * factor },
        }
    }

    fn radiance(&self, direction: Vec3) -> Vec3 {
        match self {
            Self::Flat(colour) => *colour,
            Self::Environment(image, turn, gain) => {
                image.sample(equirect_uv(direction) + Vec2::new(*turn, 0.0), 0.0) * *gain
            }
            Self::Photo { image, towards, spread, gain } => {
                let right = towards.cross(Vec3::Z).normalize_or(Vec3::X);
                let down = towards.cross(right);
                let along = direction.dot(*towards).max(1e-3);
                let aspect = image.size().x / image.size().y;
                let uv = Vec2::new(direction.dot(right), direction.dot(down) * aspect) / (2.0 * spread * along) + 0.5;
                image.sample(uv, 1.0) * *gain
            }
        }
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
