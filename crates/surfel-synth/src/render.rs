//! A picture with its ground truth, and the ray caster that takes it of an analytic scene.
//!
//! Colour is supersampled like a sensor integrates; depth, normal and object are those of the one ray
//! through the pixel's centre, so they are exact and never averages across an edge. Invariant: the
//! result depends on the scene, the camera and the options only, never on the number of threads.

use crate::random::Random;
use crate::scene::{Scene, SceneHit, facing};
use crate::shape::Ray;
use crate::texture::srgb_from_linear;
use glam::{DVec2, Vec3};
use rayon::prelude::*;
use surfel_core::{Camera, Grid, View};

/// [`RenderedView::object`] where the ray meets nothing.
pub const NOTHING: u8 = 0;
/// [`RenderedView::object`] on the surroundings: ground, table, walls.
pub const SURROUNDINGS: u8 = 255;

/// A view with exact depth, normal and object per pixel.
#[derive(Clone, Debug)]
pub struct RenderedView {
    /// The photograph and its camera; every pixel is valid.
    pub view: View,
    /// z-depth at the pixel centre, scene units; 0 where the ray meets nothing.
    pub depth: Grid<f32>,
    /// Unit normal at the pixel centre, camera frame, facing the camera; zero where there is none.
    pub normal: Grid<[f32; 3]>,
    /// [`NOTHING`], [`SURROUNDINGS`] or the number of the object, from 1.
    pub object: Grid<u8>,
}

impl RenderedView {
    /// True on the objects: neither surroundings nor backdrop.
    pub fn object_mask(&self) -> Grid<bool> {
        self.object.map(|&id| id != NOTHING && id != SURROUNDINGS)
    }
}

/// How an analytic scene is photographed.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderOptions {
    /// Colour rays per pixel along each axis.
    pub supersampling: usize,
    /// Standard deviation of the sensor noise, sRGB units.
    pub noise: f32,
    /// Names the sensor noise; combine with the view's number to give each view its own.
    pub noise_seed: u64,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self { supersampling: 2, noise: 0.0, noise_seed: 0 }
    }
}

/// The world ray of a continuous pixel; its parameter is the z-depth.
pub fn pixel_ray(camera: &Camera, pixel: DVec2) -> Ray {
    let world_from_camera = camera.camera_from_world.inverse();
    Ray { origin: world_from_camera.translation, direction: world_from_camera.rotation * camera.ray(pixel) }
}

/// What one pixel records.
#[derive(Clone, Copy)]
pub(crate) struct Pixel {
    pub colour: [f32; 3],
    pub depth: f32,
    pub normal: [f32; 3],
    pub object: u8,
}

/// A grid computed by `pixel(x, y)` in parallel; the same on any number of threads.
pub(crate) fn parallel_grid<T: Send>(camera: &Camera, pixel: impl Fn(usize, usize) -> T + Sync) -> Grid<T> {
    let (width, height) = (camera.width, camera.height);
    let pixels = (0..width * height).into_par_iter().with_min_len(64).map(|i| pixel(i % width, i / width));
    Grid::from_vec(width, height, pixels.collect())
}

/// A [`RenderedView`] of its pixels.
pub(crate) fn assemble(name: String, camera: &Camera, pixels: &Grid<Pixel>) -> RenderedView {
    RenderedView {
        view: View::new(name, pixels.map(|p| p.colour), *camera),
        depth: pixels.map(|p| p.depth),
        normal: pixels.map(|p| p.normal),
        object: pixels.map(|p| p.object),
    }
}

/// True when one of the four neighbours saw something else: then one ray does not speak for the pixel.
pub(crate) fn is_edge<T>(seen: &Grid<Option<T>>, x: usize, y: usize, differ: impl Fn(&T, &T) -> bool) -> bool {
    let (column, row) = (x as isize, y as isize);
    let around = [(1, 0), (-1, 0), (0, 1), (0, -1)];
    around.iter().filter_map(|(dx, dy)| seen.get(column + dx, row + dy)).any(|other| match (&seen[(x, y)], other) {
        (None, None) => false,
        (Some(a), Some(b)) => differ(a, b),
        _ => true,
    })
}

/// The ray through cell `i` of a pixel divided into `n` x `n`.
pub(crate) fn subpixel_ray(camera: &Camera, x: usize, y: usize, i: usize, n: usize) -> Ray {
    let offset = DVec2::new((i % n) as f64 + 0.5, (i / n) as f64 + 0.5) / n as f64;
    pixel_ray(camera, DVec2::new(x as f64, y as f64) + offset)
}

/// What the ray through a pixel's centre met, and how much light falls there.
struct Sighting {
    hit: SceneHit,
    irradiance: f32,
}

impl Sighting {
    fn differs(&self, other: &Self) -> bool {
        self.hit.object != other.hit.object
            || (self.hit.t - other.hit.t).abs() > 0.02 * self.hit.t
            || self.hit.normal.dot(other.hit.normal) < 0.9
            || (self.irradiance - other.irradiance).abs() > 0.05
    }
}

impl Scene {
    /// Photographs the scene.
    ///
    /// Inside a surface the colour rays of a pixel meet its tangent plane, which no picture can tell from the
    /// surface; at edges of depth, slope or shadow each is traced.
    pub fn render(&self, camera: &Camera, name: impl Into<String>, options: &RenderOptions) -> RenderedView {
        let n = options.supersampling.max(1);
        let centre = |x: usize, y: usize| pixel_ray(camera, Camera::pixel_centre(x, y));
        let sightings = parallel_grid(camera, |x, y| {
            let ray = centre(x, y);
            self.trace(&ray, 0.0).map(|hit| Sighting { hit, irradiance: self.irradiance(&ray, &hit) })
        });
        let pixels = parallel_grid(camera, |x, y| {
            let seen = sightings[(x, y)].as_ref();
            let ray = centre(x, y);
            let is_edge = is_edge(&sightings, x, y, Sighting::differs);
            let sample = |i: usize| {
                let sub_ray = subpixel_ray(camera, x, y, i, n);
                match seen.filter(|_| !is_edge) {
                    Some(Sighting { hit, irradiance }) => {
                        let on_plane = hit.normal.dot(ray.direction * hit.t) / hit.normal.dot(sub_ray.direction);
                        // Seen edge-on, the tangent plane runs away from the surface.
                        let t = if (on_plane / hit.t - 1.0).abs() < 0.02 { on_plane } else { hit.t };
                        self.albedo(hit.object, sub_ray.at(t)) * *irradiance
                    }
                    None => self.radiance(&sub_ray),
                }
            };
            let light = (0..n * n).map(sample).sum::<Vec3>() / (n * n) as f32;
            let mut random = Random::fork(options.noise_seed, (y * camera.width + x) as u64);
            let colour = light.to_array().map(|c| {
                let noise = if options.noise > 0.0 { options.noise * random.normal() as f32 } else { 0.0 };
                (srgb_from_linear(c) + noise).clamp(0.0, 1.0)
            });
            let Some(Sighting { hit, .. }) = seen else {
                return Pixel { colour, depth: 0.0, normal: [0.0; 3], object: NOTHING };
            };
            let normal = camera.camera_from_world.rotation * facing(hit.normal, &ray);
            let object = self.object_id(hit.object);
            Pixel { colour, depth: hit.t as f32, normal: normal.as_vec3().to_array(), object }
        });
        assemble(name.into(), camera, &pixels)
    }
}
