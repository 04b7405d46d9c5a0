//! A picture with its ground truth, and the ray caster that takes it of an analytic scene.
//!
//! Colour is supersampled like a sensor integrates; depth, normal and object are those of the one ray
//! through the pixel's centre, so they are exact and never averages across an edge. Invariant: the
//! result depends on the scene, the camera and the options only, never on the number of threads.

use crate::random::Random;
use crate::scene::Scene;
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
        Self { supersampling: 3, noise: 0.0, noise_seed: 0 }
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

/// Fills a [`RenderedView`] by calling `pixel(x, y)` for all pixels, rows in parallel.
pub(crate) fn assemble(name: String, camera: &Camera, pixel: impl Fn(usize, usize) -> Pixel + Sync) -> RenderedView {
    let (width, height) = (camera.width, camera.height);
    let pixels: Vec<Pixel> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| pixel(x, y))
        .collect();
    let grid = Grid::from_vec(width, height, pixels);
    RenderedView {
        view: View::new(name, grid.map(|p| p.colour), *camera),
        depth: grid.map(|p| p.depth),
        normal: grid.map(|p| p.normal),
        object: grid.map(|p| p.object),
    }
}

impl Scene {
    /// Photographs the scene.
    pub fn render(&self, camera: &Camera, name: impl Into<String>, options: &RenderOptions) -> RenderedView {
        let n = options.supersampling.max(1);
        assemble(name.into(), camera, |x, y| {
            let light: Vec3 = (0..n * n)
                .map(|i| {
                    let offset = DVec2::new((i % n) as f64 + 0.5, (i / n) as f64 + 0.5) / n as f64;
                    self.radiance(&pixel_ray(camera, DVec2::new(x as f64, y as f64) + offset))
                })
                .sum();
            let mut random = Random::fork(options.noise_seed, (y * camera.width + x) as u64);
            let colour = (light / (n * n) as f32).to_array().map(|c| {
                let noise = if options.noise > 0.0 { options.noise * random.normal() as f32 } else { 0.0 };
                (srgb_from_linear(c) + noise).clamp(0.0, 1.0)
            });
            let ray = pixel_ray(camera, Camera::pixel_centre(x, y));
            match self.trace(&ray, 0.0) {
                None => Pixel { colour, depth: 0.0, normal: [0.0; 3], object: NOTHING },
                Some(hit) => {
                    let facing = if hit.normal.dot(ray.direction) > 0.0 { -hit.normal } else { hit.normal };
                    let normal = (camera.camera_from_world.rotation * facing).as_vec3().to_array();
                    Pixel { colour, depth: hit.t as f32, normal, object: self.object_id(hit.object) }
                }
            }
        })
    }
}
