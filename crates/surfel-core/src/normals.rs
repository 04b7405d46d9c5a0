//! Surface normals of a depth map (spec 2.9), camera frame, OpenCV axes, facing the camera (n_z < 0).
//!
//! Invariant: the normal of the depth map of any plane is that plane's normal, at any focal length,
//! principal point and unit.

use crate::{Camera, Grid, Intrinsics};

/// Unit normal per pixel from central differences of z-depth; `None` where the pixel or one of its four
/// neighbours has no depth (not finite or <= 0), and on the border.
pub fn normals_from_depth(depth: &Grid<f32>, intrinsics: &Intrinsics) -> Grid<Option<[f32; 3]>> {
    let (width, height) = (depth.width(), depth.height());
    Grid::from_fn(width, height, |x, y| {
        if x == 0 || y == 0 || x + 1 >= width || y + 1 >= height {
            return None;
        }
        let z = depth_at(depth, x, y)?;
        let z_x = (depth_at(depth, x + 1, y)? - depth_at(depth, x - 1, y)?) / 2.0;
        let z_y = (depth_at(depth, x, y + 1)? - depth_at(depth, x, y - 1)?) / 2.0;
        Some(normal_from_gradient(intrinsics, x as f64, y as f64, z, z_x, z_y))
    })
}

/// Unit camera-frame normal at index pixel `(x, y)` of a surface with z-depth `z` and depth gradient
/// `(z_x, z_y)` per pixel.
pub fn normal_from_gradient(k: &Intrinsics, x: f64, y: f64, z: f64, z_x: f64, z_y: f64) -> [f32; 3] {
    let centre = k.principal_index();
    let n = glam::DVec3::new(k.fx * z_x, k.fy * z_y, -(z + (x - centre.x) * z_x + (y - centre.y) * z_y));
    n.normalize_or(glam::DVec3::NEG_Z).as_vec3().to_array()
}

/// Unit camera-frame normal of a surfel seen at index pixel `(x, y)`: the third axis of its `world_from_surfel`
/// quaternion w x y z, turned to face the camera.
pub fn normal_from_rotation(camera: &Camera, x: usize, y: usize, [w, i, j, k]: [f32; 4]) -> [f32; 3] {
    let axis = glam::DQuat::from_xyzw(i.into(), j.into(), k.into(), w.into()).normalize() * glam::DVec3::Z;
    let normal = camera.camera_from_world.rotation * axis;
    let away = normal.dot(camera.ray(Camera::pixel_centre(x, y))) > 0.0;
    (if away { -normal } else { normal }).as_vec3().to_array()
}

fn depth_at(depth: &Grid<f32>, x: usize, y: usize) -> Option<f64> {
    let z = depth[(x, y)];
    (z.is_finite() && z > 0.0).then_some(f64::from(z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn normal_of_a_plane_is_the_planes_normal() {
        let k = Intrinsics { fx: 310.0, fy: 290.0, cx: 20.7, cy: 11.2 };
        let plane_normal = DVec3::new(0.4, -0.5, -0.9).normalize();
        // n . X = -3 for points X = z * ray.
        let depth = Grid::from_fn(40, 30, |x, y| {
            let centre = k.principal_index();
            let ray = DVec3::new((x as f64 - centre.x) / k.fx, (y as f64 - centre.y) / k.fy, 1.0);
            (-3.0 / plane_normal.dot(ray)) as f32
        });
        let normals = normals_from_depth(&depth, &k);
        for y in 1..29 {
            for x in 1..39 {
                let n = DVec3::from(normals[(x, y)].unwrap().map(f64::from));
                // Central differences of 1/linear are exact only to second order in one pixel.
                assert!(n.dot(plane_normal) > 1.0 - 1e-5, "{n} at {x},{y}");
            }
        }
        assert!(normals[(0, 5)].is_none());
    }
}
