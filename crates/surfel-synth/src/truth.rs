//! Exact points on the surfaces of a scene: the reference for meshes and point clouds.
//!
//! Points are where random lines, uniform among all lines through the object's bounding sphere, meet the
//! surface; by Cauchy and Crofton those are uniform by area on any shape. Invariant: every point lies on
//! the surface and inside no other solid.

use crate::random::Random;
use crate::scene::Scene;
use crate::shape::{Ray, Shape};
use glam::DVec3;
use std::f64::consts::TAU;
use surfel_core::Camera;

/// Points with outward unit normals, world frame, scene units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceSamples {
    /// Positions.
    pub points: Vec<DVec3>,
    /// Outward unit normals.
    pub normals: Vec<DVec3>,
}

impl Shape {
    /// True strictly inside a solid; planes and height fields have no inside.
    pub fn contains(&self, p: DVec3) -> bool {
        match self {
            Self::Sphere { radius } => p.length() < *radius,
            Self::Box { half } => p.abs().cmplt(*half).all(),
            Self::Solid(sdf) => sdf.distance(p) < 0.0,
            Self::Plane { .. } | Self::HeightField { .. } => false,
        }
    }
}

impl Scene {
    /// `count` points uniform by area on the object at `index`; points inside other solids are left out, so
    /// fewer come back where objects overlap.
    pub fn surface_samples(&self, index: usize, count: usize, seed: u64) -> SurfaceSamples {
        let mut random = Random::new(seed);
        let mut samples = SurfaceSamples::default();
        let mut found = 0;
        while found < count {
            found += self.append_crossings(index, &mut random, count - found, &mut samples);
        }
        samples
    }

    /// Points on all objects but the surroundings, uniform by area, one per `spacing²` on average.
    pub fn object_samples(&self, spacing: f64, seed: u64) -> SurfaceSamples {
        let mut samples = SurfaceSamples::default();
        for (index, object) in self.objects.iter().enumerate().filter(|(_, object)| !object.is_surroundings) {
            let mut random = Random::fork(seed, index as u64);
            // Crofton: a line that meets a ball of radius r crosses a surface of area S within S / (2 pi r²) times.
            let num_lines = (TAU * (object.shape.radius() / spacing).powi(2)).ceil() as usize;
            for _ in 0..num_lines {
                self.append_crossings(index, &mut random, usize::MAX, &mut samples);
            }
        }
        samples
    }

    /// Appends where a random line crosses the object at `index`, `most` times at most, and returns how often it
    /// did; crossings inside other solids count but are not appended.
    fn append_crossings(&self, index: usize, random: &mut Random, most: usize, samples: &mut SurfaceSamples) -> usize {
        let object = &self.objects[index];
        let radius = object.shape.radius();
        let ray = random_line(random, radius);
        let (mut t, mut found) = (0.0, 0);
        while let Some(hit) = object.shape.intersect(&ray, t).filter(|_| found < most) {
            t = hit.t + 1e-6 * radius;
            found += 1;
            let point = object.world_from_shape.transform(ray.at(hit.t));
            if !self.is_inside_another(index, point) {
                samples.points.push(point);
                samples.normals.push(object.world_from_shape.rotation * hit.normal);
            }
        }
        found
    }

    /// The samples that at least one camera sees, unoccluded and inside its image.
    pub fn visible_samples(&self, samples: &SurfaceSamples, cameras: &[Camera]) -> SurfaceSamples {
        let seen = |p: DVec3| cameras.iter().any(|camera| self.sees(camera, p));
        let pairs = samples.points.iter().zip(&samples.normals).filter(|(p, _)| seen(**p));
        let (points, normals) = pairs.map(|(p, n)| (*p, *n)).unzip();
        SurfaceSamples { points, normals }
    }

    /// True when nothing stands between the camera and the point, and the point is in the image.
    pub fn sees(&self, camera: &Camera, point: DVec3) -> bool {
        let Some((pixel, depth)) = camera.project(point) else {
            return false;
        };
        let ray = Ray { origin: camera.centre(), direction: (point - camera.centre()) / depth };
        camera.contains(pixel) && self.trace(&ray, 0.0).is_none_or(|hit| hit.t > depth * (1.0 - 1e-6))
    }

    fn is_inside_another(&self, index: usize, point: DVec3) -> bool {
        self.objects.iter().enumerate().any(|(other, placed)| {
            other != index && placed.shape.contains(placed.world_from_shape.inverse().transform(point))
        })
    }
}

/// A line uniform among those that meet the ball of `radius` about the origin, starting outside it.
fn random_line(random: &mut Random, radius: f64) -> Ray {
    let direction = random.direction();
    let (u, v) = direction.any_orthonormal_pair();
    let (r, angle) = (radius * random.unit().sqrt(), random.range(0.0, TAU));
    let through = u * (r * angle.cos()) + v * (r * angle.sin());
    Ray { origin: through - direction * (2.0 * radius), direction }
}
