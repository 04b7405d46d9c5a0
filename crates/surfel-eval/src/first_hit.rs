//! Which faces of a mesh a camera sees, and how far they are: the first one hit by the ray of each pixel centre.
//!
//! A z-buffer of face indices and depth. Invariant: equal to casting one ray per pixel, for faces wholly in front of the camera;
//! a face that reaches behind it is not drawn.

use glam::{DVec2, DVec3};
use surfel_core::{Camera, Grid, TriMesh};

/// Index of the nearest face per pixel, `None` where the ray hits nothing.
pub fn first_hit(mesh: &TriMesh, camera: &Camera) -> Grid<Option<u32>> {
    z_buffer(mesh, camera).0
}

/// z-depth per pixel centre, scene units, 0 where the ray hits nothing.
pub fn mesh_depth(mesh: &TriMesh, camera: &Camera) -> Grid<f32> {
    z_buffer(mesh, camera).1.map(|&nearness| if nearness > 0.0 { (1.0 / nearness) as f32 } else { 0.0 })
}

/// Face and inverse depth per pixel, 0 where there is none.
fn z_buffer(mesh: &TriMesh, camera: &Camera) -> (Grid<Option<u32>>, Grid<f64>) {
    let mut face_of = Grid::filled(camera.width, camera.height, None);
    let mut inverse_depth = Grid::filled(camera.width, camera.height, 0.0f64);
    for face in 0..mesh.triangles.len() {
        let corners = mesh.corners(face).map(|c| camera.project(DVec3::from(c.map(f64::from))));
        let [Some(a), Some(b), Some(c)] = corners else { continue };
        for_each_pixel([a.0, b.0, c.0], camera, |x, y, weights| {
            // 1/z is linear in the image; z is not.
            let nearness = weights[0] / a.1 + weights[1] / b.1 + weights[2] / c.1;
            if nearness > inverse_depth[(x, y)] {
                inverse_depth[(x, y)] = nearness;
                face_of[(x, y)] = Some(face as u32);
            }
        });
    }
    (face_of, inverse_depth)
}

/// Calls `visit(x, y, barycentric weights)` for every pixel whose centre lies in the image triangle.
fn for_each_pixel([a, b, c]: [DVec2; 3], camera: &Camera, mut visit: impl FnMut(usize, usize, [f64; 3])) {
    let area = (b - a).perp_dot(c - a);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    // Pixel centres are at half-integers: the first one at or after an edge, the first one beyond.
    let span = |low: f64, high: f64, size: usize| {
        let clamped = |v: f64| (v - 0.5).clamp(0.0, size as f64);
        (clamped(low).ceil() as usize, ((clamped(high).floor() as usize) + 1).min(size))
    };
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    if high.x < 0.5 || high.y < 0.5 {
        return;
    }
    let ((x0, x1), (y0, y1)) = (span(low.x, high.x, camera.width), span(low.y, high.y, camera.height));
    for y in y0..y1 {
        for x in x0..x1 {
            let p = Camera::pixel_centre(x, y);
            let weights = [(c - b).perp_dot(p - b), (a - c).perp_dot(p - c), (b - a).perp_dot(p - a)].map(|w| w / area);
            if weights.iter().all(|&w| w >= 0.0) {
                visit(x, y, weights);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_core::{Intrinsics, Rigid};

    /// Distance along `ray` to a triangle (Moeller-Trumbore).
    fn hit([a, b, c]: [DVec3; 3], origin: DVec3, ray: DVec3) -> Option<f64> {
        let (e1, e2) = (b - a, c - a);
        let p = ray.cross(e2);
        let det = e1.dot(p);
        let to_origin = origin - a;
        let u = to_origin.dot(p) / det;
        let q = to_origin.cross(e1);
        let v = ray.dot(q) / det;
        (det != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0).then(|| e2.dot(q) / det).filter(|&t| t > 0.0)
    }

    #[test]
    fn the_buffer_shows_what_rays_hit() {
        let intrinsics = Intrinsics { fx: 30.0, fy: 32.0, cx: 16.3, cy: 11.9 };
        let rotation = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.2, -0.3, 0.1);
        let camera = Camera {
            intrinsics,
            width: 32,
            height: 24,
            camera_from_world: Rigid::from_quat(rotation, DVec3::new(0.1, 0.2, 6.0)),
        };
        // A tangle of faces of all sizes, some reaching out of the image.
        let coordinate = |i: usize| ((i * 2_654_435_761) % 1009) as f32 / 1009.0 * 6.0 - 3.0;
        let mesh = TriMesh {
            positions: (0..90).map(|i| [coordinate(3 * i), coordinate(3 * i + 1), coordinate(3 * i + 2)]).collect(),
            triangles: (0..30).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            ..TriMesh::default()
        };
        let seen = first_hit(&mesh, &camera);
        let world_from_camera = camera.camera_from_world.inverse();
        let mut num_hits = 0;
        for y in 0..24 {
            for x in 0..32 {
                let ray = world_from_camera.rotation * camera.ray(Camera::pixel_centre(x, y));
                let nearest = (0..30usize)
                    .filter_map(|f| {
                        let corners = mesh.corners(f).map(|c| DVec3::from(c.map(f64::from)));
                        hit(corners, camera.centre(), ray).map(|t| (t, f as u32))
                    })
                    .min_by(|a, b| a.0.total_cmp(&b.0));
                assert_eq!(seen[(x, y)], nearest.map(|(_, f)| f), "pixel {x},{y}");
                num_hits += usize::from(nearest.is_some());
            }
        }
        assert!(num_hits > 200, "{num_hits} hits are too few to mean anything");
    }
}
