//! The exact surface of a scene's objects: their triangles in the world, and points spread over them.
//!
//! What reconstructions of rendered scenes are scored against. Invariant: every point lies on a triangle, points are
//! uniform by area, and a point counts as seen only when a ray from a camera reaches it.

use super::sampler::SynthScene;
use crate::random::Random;
use crate::shape::Ray;
use crate::truth::SurfaceSamples;
use glam::DVec3;
use rayon::prelude::*;
use surfel_core::{Camera, TriMesh};

/// How far before a point, relative to its distance, a ray may end and still have reached it: the hierarchy works in
/// single precision.
const REACH_TOLERANCE: f64 = 1e-4;

impl SynthScene {
    /// All objects as one mesh, world frame, without the panels they stand on; three vertices per triangle.
    pub fn object_mesh(&self) -> TriMesh {
        let mut mesh = TriMesh::default();
        for [a, b, c] in self.triangles() {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend([a, b, c].map(|p| p.as_vec3().to_array()));
            mesh.triangles.push([first, first + 1, first + 2]);
        }
        mesh
    }

    /// Points on the objects, uniform by area, one per `spacing²` on average, that at least one camera sees.
    pub fn seen_samples(&self, spacing: f64, seed: u64) -> SurfaceSamples {
        let mut random = Random::new(seed);
        let mut samples: Vec<(DVec3, DVec3)> = Vec::new();
        for [a, b, c] in self.triangles() {
            let (u, v) = (b - a, c - a);
            let cross = u.cross(v);
            // A fractional number of points is rounded at random, or small triangles would never get one.
            let count = (0.5 * cross.length() / (spacing * spacing) + random.unit()).floor() as usize;
            samples.extend((0..count).map(|_| {
                let (s, t) = (random.unit(), random.unit());
                let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
                (a + u * s + v * t, cross.normalize_or(DVec3::Z))
            }));
        }
        let seen = |(p, _): &(DVec3, DVec3)| self.cameras.iter().any(|camera| self.sees(camera, *p));
        let (points, normals) = samples.into_par_iter().filter(seen).unzip();
        SurfaceSamples { points, normals }
    }

    /// True when the point is in the image and nothing stands before it.
    pub fn sees(&self, camera: &Camera, point: DVec3) -> bool {
        let Some((pixel, depth)) = camera.project(point) else { return false };
        let ray = Ray { origin: camera.centre(), direction: (point - camera.centre()) / depth };
        camera.contains(pixel) && self.stage.trace(&ray).is_none_or(|hit| hit.t > depth * (1.0 - REACH_TOLERANCE))
    }

    /// World corners of every triangle of every object.
    fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.stage.instances.iter().flat_map(|instance| {
            (0..instance.mesh.num_triangles())
                .map(|i| instance.mesh.positions(i).map(|p| instance.world_from_mesh.transform(p.as_dvec3())))
        })
    }
}
