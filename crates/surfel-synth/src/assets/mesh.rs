//! A textured mesh ready for rays: normalised, with a bounding volume hierarchy and shading data.
//!
//! Mesh frame: up is +Z, the middle of the bounding box is the origin, the farthest vertex has distance 1.
//! Invariant: triangles stand in the order of the hierarchy's leaves, so a leaf slot is a triangle index.

use super::glb::Glb;
use super::texels::Texels;
use glam::{Vec2, Vec3, Vec3A};
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh_from_tris};
use obvhs::ray::{Ray, RayHit};
use std::sync::Arc;

/// A mesh as the renderer wants it.
pub struct TexturedMesh {
    pub(super) triangles: Vec<Triangle>,
    pub(super) corners: Vec<Corners>,
    materials: Vec<Material>,
    bvh: CwBvh,
    /// Positions of all vertices, mesh frame; what arranging objects needs.
    pub vertices: Vec<Vec3>,
    /// True when at least one material has an image.
    pub is_textured: bool,
    /// Largest edge of the bounding box in the file's units (metres for scans).
    pub extent: f32,
}

#[derive(Clone, Copy)]
pub(super) struct Triangle {
    origin: Vec3A,
    pub edges: [Vec3A; 2],
}

/// Shading data of a triangle's three corners.
#[derive(Clone, Copy)]
pub(super) struct Corners {
    uvs: [Vec2; 3],
    pub normals: [Vec3; 3],
    pub openness: [f32; 3],
    material: u32,
}

struct Material {
    base_colour: Vec3,
    image: Option<Arc<Texels>>,
}

/// Where a ray meets a mesh.
#[derive(Clone, Copy, Debug)]
pub struct MeshHit {
    /// Ray parameter.
    pub t: f32,
    /// Index of the triangle.
    pub triangle: u32,
}

/// The surface at a hit, mesh frame.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Geometric unit normal (of the triangle), outward.
    pub normal: Vec3,
    /// Unit normal interpolated from the corners, for shading only.
    pub smooth_normal: Vec3,
    /// Share of the sky the surface itself leaves open here, in \[0, 1\].
    pub openness: f32,
    /// Linear base colour.
    pub albedo: Vec3,
}

/// What decides where the mesh frame lies in the frame of the points.
pub(super) struct Enclosure {
    /// Middle of the bounding box.
    pub middle: Vec3,
    /// Distance of the farthest point from it.
    pub radius: f32,
    /// Largest edge of the bounding box.
    pub extent: f32,
}

impl Enclosure {
    /// Of some points; `None` of none.
    pub fn of(points: impl Iterator<Item = Vec3> + Clone) -> Option<Self> {
        let first = points.clone().next()?;
        let (low, high) = points.clone().fold((first, first), |(low, high), p| (low.min(p), high.max(p)));
        let middle = 0.5 * (low + high);
        let radius = points.map(|p| (p - middle).length()).fold(0.0, f32::max);
        Some(Self { middle, radius, extent: (high - low).max_element() })
    }
}

/// Slack of the barycentric test, so that no ray slips through a shared edge.
const EDGE_SLACK: f32 = 1e-6;

impl TexturedMesh {
    /// Normalises a file's primitives; `up_is_y` turns glTF's Y-up into Z-up. `None` without a triangle.
    pub fn new(glb: &Glb<'_>, images: &[Arc<Texels>], up_is_y: bool) -> Option<Self> {
        let upright = |[x, y, z]: [f32; 3]| if up_is_y { Vec3::new(x, -z, y) } else { Vec3::new(x, y, z) };
        let all = || glb.primitives.iter().flat_map(|p| &p.positions).map(|&p| upright(p));
        let Enclosure { middle, radius, extent } = Enclosure::of(all())?;
        let normalised = |p: [f32; 3]| (upright(p) - middle) / radius.max(f32::MIN_POSITIVE);

        let (mut triangles, mut corners, mut vertices, mut materials) = (vec![], vec![], vec![], vec![]);
        for (material, primitive) in glb.primitives.iter().enumerate() {
            let positions: Vec<Vec3> = primitive.positions.iter().map(|&p| normalised(p)).collect();
            for &indices in &primitive.triangles {
                let [a, b, c] = indices.map(|i| positions[i as usize]);
                if (b - a).cross(c - a).length_squared() < 1e-16 {
                    continue;
                }
                let uv = |i: u32| primitive.uvs.get(i as usize).map_or(Vec2::ZERO, |&uv| Vec2::from(uv));
                triangles.push(Triangle { origin: a.into(), edges: [(b - a).into(), (c - a).into()] });
                corners.push(Corners {
                    uvs: indices.map(uv),
                    normals: [Vec3::Z; 3],
                    openness: [1.0; 3],
                    material: material as u32,
                });
            }
            vertices.extend(positions);
            let image = primitive.image.and_then(|i| images.get(i)).cloned();
            materials.push(Material { base_colour: Vec3::from(primitive.base_colour), image });
        }
        if triangles.is_empty() {
            return None;
        }
        let bvh = build_bvh(&triangles);
        let order = |i: &u32| *i as usize;
        let triangles: Vec<_> = bvh.primitive_indices.iter().map(|i| triangles[order(i)]).collect();
        let corners: Vec<_> = bvh.primitive_indices.iter().map(|i| corners[order(i)]).collect();
        let is_textured = materials.iter().any(|m| m.image.is_some());
        let mut mesh = Self { triangles, corners, materials, bvh, vertices, is_textured, extent };
        mesh.smooth_normals();
        mesh.measure_openness();
        Some(mesh)
    }

    /// Number of triangles.
    pub fn num_triangles(&self) -> usize {
        self.triangles.len()
    }

    /// Corner positions of a triangle, mesh frame.
    pub fn positions(&self, triangle: usize) -> [Vec3; 3] {
        let Triangle { origin, edges: [u, v] } = self.triangles[triangle];
        [origin, origin + u, origin + v].map(Vec3::from)
    }

    /// Bytes held, without what materials share with other meshes.
    pub fn memory(&self) -> usize {
        let geometry = size_of_val(&self.triangles[..]) + size_of_val(&self.corners[..]) + 12 * self.vertices.len();
        let hierarchy = size_of_val(&self.bvh.nodes[..]) + 4 * self.bvh.primitive_indices.len();
        let images = self.materials.iter().filter_map(|m| m.image.as_ref()).map(|image| image.memory());
        geometry + hierarchy + images.sum::<usize>()
    }

    /// First hit with parameter in `(t_min, t_max)`; both sides of a triangle count.
    pub fn intersect(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<MeshHit> {
        let ray = Ray::new(origin.into(), direction.into(), t_min, t_max);
        let mut hit = RayHit::none();
        let found = self.bvh.ray_traverse(ray, &mut hit, |ray, slot| self.triangles[slot].intersect(ray));
        found.then_some(MeshHit { t: hit.t, triangle: hit.primitive_id })
    }

    /// True when anything stands in `(t_min, t_max)`.
    pub fn occludes(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> bool {
        let ray = Ray::new(origin.into(), direction.into(), t_min, t_max);
        !self.bvh.ray_traverse_miss(ray, |ray, slot| self.triangles[slot].intersect(ray))
    }

    /// The surface of `triangle` at a point on it; `footprint` is the width of a pixel there, mesh frame.
    pub fn surface(&self, triangle: u32, point: Vec3, footprint: f32) -> SurfacePoint {
        let (shape, corners) = (&self.triangles[triangle as usize], &self.corners[triangle as usize]);
        let [u, v] = shape.edges.map(Vec3::from);
        let cross = u.cross(v);
        let double_area = cross.length();
        let normal = cross / double_area;
        let offset = point - Vec3::from(shape.origin);
        let b = offset.cross(v).dot(normal) / double_area;
        let c = u.cross(offset).dot(normal) / double_area;
        let weights = [1.0 - b - c, b, c];
        let material = &self.materials[corners.material as usize];
        let albedo = material.image.as_ref().map_or(Vec3::ONE, |image| {
            let uv: Vec2 = (0..3).map(|i| corners.uvs[i] * weights[i]).sum();
            let [a, b, c] = corners.uvs.map(|uv| uv * image.size());
            let texels_per_length = ((b - a).perp_dot(c - a).abs() / double_area).sqrt();
            image.sample(uv, (texels_per_length * footprint).log2())
        });
        let smooth: Vec3 = (0..3).map(|i| corners.normals[i] * weights[i]).sum();
        SurfacePoint {
            normal,
            smooth_normal: smooth.normalize_or(normal),
            openness: (0..3).map(|i| corners.openness[i] * weights[i]).sum::<f32>().clamp(0.0, 1.0),
            albedo: albedo * material.base_colour,
        }
    }
}

impl Triangle {
    /// Möller and Trumbore 1997; infinity for a miss.
    fn intersect(&self, ray: &Ray) -> f32 {
        let [u, v] = self.edges;
        let p = ray.direction.cross(v);
        let determinant = u.dot(p);
        let inverse = 1.0 / determinant;
        let offset = ray.origin - self.origin;
        let b = offset.dot(p) * inverse;
        let q = offset.cross(u);
        let c = ray.direction.dot(q) * inverse;
        let t = v.dot(q) * inverse;
        let inside = b >= -EDGE_SLACK && c >= -EDGE_SLACK && b + c <= 1.0 + EDGE_SLACK;
        if determinant != 0.0 && inside && t > ray.tmin && t < ray.tmax { t } else { f32::INFINITY }
    }
}

fn build_bvh(triangles: &[Triangle]) -> CwBvh {
    let corners = triangles.iter().map(|t| obvhs::triangle::Triangle {
        v0: t.origin,
        v1: t.origin + t.edges[0],
        v2: t.origin + t.edges[1],
    });
    let mut build_time = std::time::Duration::ZERO;
    // Split triangles would appear in several leaves and break the order of slots.
    let parameters = obvhs::BvhBuildParams { pre_split: false, ..obvhs::BvhBuildParams::medium_build() };
    build_cwbvh_from_tris(&corners.collect::<Vec<_>>(), parameters, &mut build_time)
}
