//! Exact depth maps of simple surfaces, and questions to ask of a mesh.

#![allow(dead_code)]

use glam::{DMat3, DVec2, DVec3};
use std::collections::BTreeMap;
use surfel_core::{Camera, Grid, Intrinsics, Rigid, TriMesh};
use surfel_mesh::DepthView;

/// Distance along a ray from a point in a direction to a surface, in units of the direction's length.
pub type Hit = dyn Fn(DVec3, DVec3) -> Option<f64>;

/// A depth map with everything it needs to be borrowed as a [`DepthView`].
#[derive(Clone)]
pub struct Shot {
    pub camera: Camera,
    pub depth: Grid<f32>,
    pub colour: Grid<[f32; 3]>,
}

impl Shot {
    pub fn take(camera: Camera, hit: &Hit, colour: &dyn Fn(DVec3) -> [f32; 3]) -> Self {
        let centre = camera.centre();
        let depth_of = |x: usize, y: usize| {
            let ray = camera.ray(Camera::pixel_centre(x, y));
            hit(centre, camera.camera_from_world.rotation.transpose() * ray)
        };
        let depth = Grid::from_fn(camera.width, camera.height, |x, y| depth_of(x, y).unwrap_or(0.0) as f32);
        let colour = Grid::from_fn(camera.width, camera.height, |x, y| {
            depth_of(x, y).map_or([0.0; 3], |z| colour(camera.unproject(Camera::pixel_centre(x, y), z)))
        });
        Self { camera, depth, colour }
    }

    pub fn view(&self) -> DepthView<'_> {
        DepthView { camera: &self.camera, depth: &self.depth, colour: &self.colour, weight: None }
    }

    /// The same shot of the scene in another unit.
    pub fn scaled(&self, scale: f64) -> Self {
        let mut shot = self.clone();
        shot.camera.camera_from_world.translation *= scale;
        shot.depth = self.depth.map(|z| (f64::from(*z) * scale) as f32);
        shot
    }
}

pub fn views(shots: &[Shot]) -> Vec<DepthView<'_>> {
    shots.iter().map(Shot::view).collect()
}

/// A camera at `position` that looks at `target`, with a focal length of `focal` pixels.
pub fn looking_at(position: DVec3, target: DVec3, width: usize, height: usize, focal: f64) -> Camera {
    let forward = (target - position).normalize();
    let right = DVec3::Y.cross(forward).normalize();
    let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: width as f64 / 2.0 + 0.3, cy: height as f64 / 2.0 - 0.7 };
    let camera_from_world = Rigid { rotation, translation: -(rotation * position) };
    Camera { intrinsics, width, height, camera_from_world }
}

pub fn sphere(centre: DVec3, radius: f64) -> impl Fn(DVec3, DVec3) -> Option<f64> {
    move |from, ray| {
        let (to_centre, length_sq) = (centre - from, ray.length_squared());
        let nearest = to_centre.dot(ray) / length_sq;
        let gap_sq = (to_centre - ray * nearest).length_squared();
        let half_sq = (radius * radius - gap_sq) / length_sq;
        (half_sq > 0.0).then(|| nearest - half_sq.sqrt()).filter(|t| *t > 0.0)
    }
}

pub fn plane(point: DVec3, normal: DVec3) -> impl Fn(DVec3, DVec3) -> Option<f64> {
    move |from, ray| Some(normal.dot(point - from) / normal.dot(ray)).filter(|t| *t > 0.0)
}

/// Six cameras around the origin that see all of a unit sphere.
pub fn cameras_all_around(size: usize) -> Vec<Camera> {
    [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z, DVec3::new(0.1, 1.0, 0.0), DVec3::new(0.1, -1.0, 0.0)]
        .map(|direction| looking_at(direction * 4.0, DVec3::ZERO, size, size, size as f64 * 1.6))
        .to_vec()
}

/// A unit sphere at the origin seen from all around; its colour is its position.
pub fn sphere_shots(size: usize) -> Vec<Shot> {
    let hit = sphere(DVec3::ZERO, 1.0);
    cameras_all_around(size).into_iter().map(|camera| Shot::take(camera, &hit, &position_colour)).collect()
}

/// Two views of a sphere before a slanted wall: depth edges, occlusion and two surfaces.
pub fn sphere_and_wall() -> Vec<Shot> {
    let (ball, wall) =
        (sphere(DVec3::new(0.1, 0.0, 3.0), 0.5), plane(DVec3::Z * 4.5, DVec3::new(0.3, 0.1, -1.0).normalize()));
    let hit = move |from: DVec3, ray: DVec3| ball(from, ray).or_else(|| wall(from, ray));
    [-0.3, 0.3]
        .map(|x| Shot::take(looking_at(DVec3::X * x, DVec3::Z * 3.0, 96, 72, 90.0), &hit, &position_colour))
        .to_vec()
}

pub fn position_colour(p: DVec3) -> [f32; 3] {
    (p * 0.4 + 0.5).as_vec3().to_array()
}

/// How many triangles use each undirected edge, and whether they run along it in opposite directions.
pub fn edge_uses(mesh: &TriMesh) -> BTreeMap<(u32, u32), Vec<bool>> {
    let mut uses: BTreeMap<_, Vec<bool>> = BTreeMap::new();
    for [a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            uses.entry((*from.min(to), *from.max(to))).or_default().push(from < to);
        }
    }
    uses
}

/// Panics unless every edge has one triangle, or two with opposite directions.
pub fn assert_manifold(mesh: &TriMesh) {
    for (edge, uses) in edge_uses(mesh) {
        let fine = uses.len() == 1 || uses.len() == 2 && uses[0] != uses[1];
        assert!(fine, "edge {edge:?} is used {uses:?}");
    }
}

pub fn assert_no_repeated_vertex(mesh: &TriMesh) {
    let mut bits: Vec<_> = mesh.positions.iter().map(|p| p.map(f32::to_bits)).collect();
    bits.sort_unstable();
    bits.dedup();
    assert_eq!(bits.len(), mesh.positions.len(), "vertices repeat");
}

pub fn position(mesh: &TriMesh, vertex: u32) -> DVec3 {
    DVec3::from_array(mesh.positions[vertex as usize].map(f64::from))
}

/// Unnormalised normal of a triangle from its winding.
pub fn winding_normal(mesh: &TriMesh, triangle: usize) -> DVec3 {
    let [a, b, c] = mesh.triangles[triangle].map(|vertex| position(mesh, vertex));
    (b - a).cross(c - a)
}

/// Pixel (index coordinates) of a point, for questions about borders.
pub fn pixel_of(camera: &Camera, point: DVec3) -> DVec2 {
    camera.project(point).expect("in front of the camera").0 - 0.5
}
