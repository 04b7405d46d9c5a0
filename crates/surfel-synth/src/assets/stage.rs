//! A scene of textured meshes on flat panels under lamps and an environment: what a ray sees.
//!
//! Invariant: geometry is the triangles and panels alone. Smooth normals, gloss and occlusion change
//! colours; [`Stage::trace`] never looks at them.

use super::backdrop::Backdrop;
use super::instance::{Finish, Instance};
use super::light::{Irradiance, Lamp};
use super::panel::Panel;
use crate::shape::Ray;
use glam::{DVec3, Vec3};

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
        self.instances.iter().any(|instance| instance.blocks(&ray, reach))
    }

    /// Linear light along a ray that met `hit`. `footprint` is the width of a pixel per unit of the ray's
    /// parameter; `turn` (radians) turns the pattern of rays sent towards lamps.
    pub fn radiance(&self, ray: &Ray, hit: Option<&StageHit>, footprint: f64, turn: f32) -> Vec3 {
        let Some(hit) = hit else { return self.backdrop.radiance(ray.direction.as_vec3()) };
        let point = ray.at(hit.t);
        let facing = hit.normal.as_vec3();
        // Half of the stretching of the footprint at a slant: sharp across, a little blurred along.
        let slant = (-hit.normal.dot(ray.direction.normalize())).max(0.05).sqrt();
        let pixel = footprint * hit.t / slant;
        let finish = match hit.part {
            Part::Panel(i) => self.panels[i].finish(point, pixel, facing),
            Part::Instance(i, triangle) => {
                let instance = &self.instances[i];
                let finish = instance.finish(triangle, point, pixel, facing);
                let contact = self.contact(point, finish.normal, instance.world_from_mesh.scale);
                Finish { openness: finish.openness * contact, ..finish }
            }
        };
        let Finish { albedo, normal, openness, gloss, shininess } = finish;
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

    /// Near the ground the lower half of the sky is missing: the share that is left for a normal.
    fn contact(&self, point: DVec3, normal: Vec3, size: f64) -> f32 {
        let height = ((point.z - self.ground_height()) / (0.6 * size)).clamp(0.0, 1.0) as f32;
        let downward = 0.5 - 0.5 * normal.z;
        1.0 - 0.65 * downward * (1.0 - height)
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
