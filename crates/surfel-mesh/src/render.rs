//! A small software renderer: the mesh as a camera sees it, for previews and for checking depth.
//!
//! Works on rays instead of projected triangles: with corners `P = [p0 p1 p2]` in the camera frame, the
//! ray `r` (z = 1) meets the triangle where `b = P⁻¹ r >= 0`, at depth `1 / sum(b)` with barycentric weights
//! `b / sum(b)`; nothing needs clipping and interpolation is perspective-correct by construction. Invariant:
//! triangles that share an edge leave no gap, and the result does not depend on the number of threads.

use glam::{DMat3, DVec2, DVec3, Vec3};
use rayon::prelude::*;
use surfel_core::{Camera, Grid, TriMesh};

/// What a camera sees of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshRender {
    /// Vertex colours under a headlight, sRGB in \[0, 1\]; [`BACKGROUND`] where there is no mesh.
    pub colour: Grid<[f32; 3]>,
    /// z-depth at the pixel centres, in the unit of the mesh; 0 = no mesh.
    pub depth: Grid<f32>,
}

/// Colour of pixels without mesh.
pub const BACKGROUND: [f32; 3] = [0.94, 0.94, 0.935];
/// Colour of a mesh without colours.
const CLAY: [f32; 3] = [0.78, 0.77, 0.75];
/// Brightness of a surface seen edge-on: photographs carry their own shading, so the headlight only hints.
const AMBIENT: f32 = 0.45;
/// Rows rendered by one thread at a time.
const BAND: usize = 16;

/// Renders both sides of every triangle with a hard z-buffer; the camera's world is the frame of the mesh.
///
/// # Panics
/// If a triangle index is out of range (the invariant of [`TriMesh`]).
pub fn render_mesh(mesh: &TriMesh, camera: &Camera) -> MeshRender {
    let (width, height) = (camera.width, camera.height);
    let pose = &camera.camera_from_world;
    let corners: Vec<DVec3> = mesh.positions.par_iter().map(|p| pose.transform(Vec3::from(*p).as_dvec3())).collect();
    let footprints: Vec<Option<Footprint>> =
        mesh.triangles.par_iter().map(|t| Footprint::of(t.map(|v| corners[v as usize]), camera)).collect();
    // Counted first, so that each band lists its triangles in mesh order whatever the threads do.
    let mut bands: Vec<Vec<u32>> = vec![Vec::new(); height.div_ceil(BAND)];
    for (index, footprint) in footprints.iter().enumerate() {
        if let Some(Footprint { rows, .. }) = footprint {
            bands[rows.0 / BAND..=rows.1 / BAND].iter_mut().for_each(|band| band.push(index as u32));
        }
    }
    let mut colour = vec![BACKGROUND; width * height];
    let mut depth = vec![0.0f32; width * height];
    let rows = colour.par_chunks_mut(width.max(1) * BAND).zip(depth.par_chunks_mut(width.max(1) * BAND));
    rows.zip(&bands).enumerate().for_each(|(band, ((colour, depth), triangles))| {
        for &index in triangles {
            let Some(footprint) = &footprints[index as usize] else { continue };
            let triangle = mesh.triangles[index as usize];
            let Some(hits) = Hits::new(triangle.map(|v| corners[v as usize])) else { continue };
            let (top, bottom) = (footprint.rows.0.max(band * BAND), footprint.rows.1.min(band * BAND + BAND - 1));
            for y in top..=bottom {
                for x in footprint.columns.0..=footprint.columns.1 {
                    let ray = camera.ray(Camera::pixel_centre(x, y));
                    let Some((z, weights)) = hits.at(ray) else { continue };
                    let pixel = (y - band * BAND) * width + x;
                    if depth[pixel] == 0.0 || z < depth[pixel] {
                        depth[pixel] = z;
                        colour[pixel] = shade(mesh, triangle, weights, &hits, pose.rotation, ray);
                    }
                }
            }
        }
    });
    MeshRender { colour: Grid::from_vec(width, height, colour), depth: Grid::from_vec(width, height, depth) }
}

/// Pixel ranges (inclusive) that a triangle may touch.
struct Footprint {
    columns: (usize, usize),
    rows: (usize, usize),
}

impl Footprint {
    fn of(corners: [DVec3; 3], camera: &Camera) -> Option<Self> {
        let size = DVec2::new(camera.width as f64, camera.height as f64);
        let (mut low, mut high) = (DVec2::ZERO, size);
        if corners.iter().all(|p| p.z > 0.0) {
            let k = &camera.intrinsics;
            let pixels = corners.map(|p| DVec2::new(k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy));
            low = pixels.into_iter().fold(high, DVec2::min).max(low);
            high = pixels.into_iter().fold(DVec2::ZERO, DVec2::max).min(high);
        } else if !corners.iter().any(|p| p.z > 0.0) {
            return None;
        }
        // Pixel centres lie at half-integers.
        let first = (low - 0.5).ceil().max(DVec2::ZERO);
        let last = (high - 0.5).floor().min(size - 1.0);
        (first.x <= last.x && first.y <= last.y)
            .then_some(Self { columns: (first.x as usize, last.x as usize), rows: (first.y as usize, last.y as usize) })
    }
}

/// Intersection of rays through the camera centre with one triangle.
struct Hits {
    /// Rows of the adjugate of `P`; neighbours across an edge hold exact negatives of each other's.
    edges: [DVec3; 3],
    determinant: f64,
}

impl Hits {
    fn new([a, b, c]: [DVec3; 3]) -> Option<Self> {
        let edges = [b.cross(c), c.cross(a), a.cross(b)];
        let determinant = a.dot(edges[0]);
        (determinant != 0.0 && determinant.is_finite()).then_some(Self { edges, determinant })
    }

    /// z-depth and barycentric weights where `ray` (z = 1) meets the triangle in front of the camera.
    fn at(&self, ray: DVec3) -> Option<(f32, [f32; 3])> {
        let b = self.edges.map(|edge| edge.dot(ray) * self.determinant.signum());
        let sum = b[0] + b[1] + b[2];
        let hit = b.iter().all(|&b| b >= 0.0) && sum > 0.0;
        hit.then(|| ((self.determinant.abs() / sum) as f32, b.map(|b| (b / sum) as f32)))
    }

    /// Normal of the plane, camera frame, any length: `P⁻ᵀ (1, 1, 1)` up to scale.
    fn plane_normal(&self) -> DVec3 {
        self.edges[0] + self.edges[1] + self.edges[2]
    }
}

/// Vertex colour times headlight Lambert.
fn shade(
    mesh: &TriMesh,
    triangle: [u32; 3],
    weights: [f32; 3],
    hits: &Hits,
    camera_from_world: DMat3,
    ray: DVec3,
) -> [f32; 3] {
    let blend = |corner: &dyn Fn(usize) -> Vec3| -> Vec3 {
        triangle.iter().zip(weights).map(|(&v, weight)| corner(v as usize) * weight).sum()
    };
    let normal = if mesh.normals.is_empty() {
        hits.plane_normal()
    } else {
        camera_from_world * blend(&|v| Vec3::from(mesh.normals[v])).as_dvec3()
    };
    let cosine = normal.normalize_or_zero().dot(ray.normalize()).abs() as f32;
    let albedo = if mesh.colours.is_empty() {
        Vec3::from(CLAY)
    } else {
        blend(&|v| Vec3::from(mesh.colours[v].map(|byte| f32::from(byte) / 255.0)))
    };
    (albedo * (AMBIENT + (1.0 - AMBIENT) * cosine)).to_array()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;
    use surfel_core::{Intrinsics, Rigid};

    fn camera(width: usize, height: usize, camera_from_world: Rigid) -> Camera {
        let intrinsics = Intrinsics { fx: 60.0, fy: 55.0, cx: 20.3, cy: 14.9 };
        Camera { intrinsics, width, height, camera_from_world }
    }

    /// The obvious twin: every ray against every triangle, by the plane and three half-planes.
    fn brute_depth(mesh: &TriMesh, camera: &Camera) -> Grid<f32> {
        Grid::from_fn(camera.width, camera.height, |x, y| {
            let ray = camera.ray(Camera::pixel_centre(x, y));
            let depths = (0..mesh.triangles.len()).filter_map(|t| {
                let [a, b, c] = mesh.corners(t).map(|p| camera.camera_from_world.transform(Vec3::from(p).as_dvec3()));
                let normal = (b - a).cross(c - a);
                let z = normal.dot(a) / normal.dot(ray);
                let inside = |from: DVec3, to: DVec3| (to - from).cross(ray * z - from).dot(normal) >= 0.0;
                (z > 0.0 && inside(a, b) && inside(b, c) && inside(c, a)).then_some(z as f32)
            });
            depths.fold(0.0, |nearest, z| if nearest == 0.0 || z < nearest { z } else { nearest })
        })
    }

    proptest! {
        /// Corners lie on all sides of the camera, so triangles that cross its plane are covered.
        #[test]
        fn depth_equals_the_brute_twin(
            positions in prop::collection::vec(prop::array::uniform3(-3.0f32..3.0), 9..30),
            shift in -2.0f64..6.0,
        ) {
            let triangles = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            let mesh = TriMesh { positions, triangles, ..TriMesh::default() };
            let pose = Rigid::from_quat(DQuat::from_rotation_y(0.3), DVec3::new(0.2, -0.1, shift));
            let camera = camera(41, 33, pose);
            let (fast, slow) = (render_mesh(&mesh, &camera).depth, brute_depth(&mesh, &camera));
            let differing = fast.as_slice().iter().zip(slow.as_slice());
            let differing = differing.filter(|(f, s)| (*f - *s).abs() > 1e-4 * s.abs()).count();
            // A ray within rounding of an edge may fall on either side of it.
            prop_assert!(differing <= 2, "{differing} pixels differ");
        }
    }

    #[test]
    fn a_fan_of_triangles_has_no_gap() {
        let hub = [0.013, -0.027, 2.0];
        let rim = (0..97).map(|i| {
            let angle = i as f32 / 97.0 * std::f32::consts::TAU;
            [9.0 * angle.cos(), 9.0 * angle.sin(), 2.0 + 0.3 * angle.sin()]
        });
        let mesh = TriMesh {
            positions: std::iter::once(hub).chain(rim).collect(),
            triangles: (0..97).map(|i| [0, 1 + i, 1 + (i + 1) % 97]).collect(),
            ..TriMesh::default()
        };
        let render = render_mesh(&mesh, &camera(200, 150, Rigid::IDENTITY));
        assert!(render.depth.as_slice().iter().all(|&z| z > 0.0));
    }

    #[test]
    fn colours_are_linear_on_the_surface_not_on_the_screen() {
        // A floor from under the camera to far away whose red equals z / 10.
        let red = |z: f32| (z / 10.0 * 255.0) as u8;
        let corners = [[-9.0, 1.0, 0.0], [9.0, 1.0, 0.0], [9.0, 1.0, 10.0], [-9.0, 1.0, 10.0]];
        let mesh = TriMesh {
            positions: corners.to_vec(),
            colours: corners.map(|[_, _, z]| [red(z), 0, 0]).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            normals: vec![],
        };
        let camera = camera(40, 30, Rigid::IDENTITY);
        let render = render_mesh(&mesh, &camera);
        let mut num_floor = 0;
        for y in 0..30 {
            let ray = camera.ray(Camera::pixel_centre(20, y));
            let z = 1.0 / ray.y;
            if (0.0..9.9).contains(&z) {
                num_floor += 1;
                assert!((f64::from(render.depth[(20, y)]) - z).abs() < 1e-5 * z);
                let light = 0.45 + 0.55 * (ray.y / ray.length());
                assert!((f64::from(render.colour[(20, y)][0]) - z / 10.0 * light).abs() < 5e-3, "row {y}");
            } else {
                assert_eq!(render.colour[(20, y)], BACKGROUND);
            }
        }
        assert!(num_floor > 8);
    }

    #[test]
    fn an_empty_mesh_is_background() {
        let render = render_mesh(&TriMesh::default(), &camera(5, 4, Rigid::IDENTITY));
        assert_eq!((render.colour[(4, 3)], render.depth[(4, 3)]), (BACKGROUND, 0.0));
    }
}
