//! Maps computed from maps: surface depth and the normals of its graph, with their gradients (spec 3.5, 3.8).
//!
//! Normals are the cross product of central differences of unprojected pixels, camera frame. Invariant: the
//! normals of the depth of any plane are that plane's normal, exactly, at any intrinsics and unit.

use crate::Maps;
use glam::DVec3;
use surfel_core::{Grid, Intrinsics};

/// `(1 - ratio) * expected + ratio * median` depth (spec 3.5); `ratio` 1 is the reference's decoder.
pub fn surface_depth(maps: &Maps, ratio: f32) -> Grid<f32> {
    let (expected, median) = (maps.depth_expected.as_slice(), maps.depth_median.as_slice());
    let blend = expected.iter().zip(median).map(|(e, m)| (1.0 - ratio) * e + ratio * m).collect();
    Grid::from_vec(maps.alpha.width(), maps.alpha.height(), blend)
}

/// Unit normals of a z-depth map, camera frame, facing the camera; zero on the border and where one of the four
/// neighbours has no depth.
pub fn depth_normals(depth: &Grid<f32>, intrinsics: &Intrinsics) -> Grid<[f32; 3]> {
    Grid::from_fn(depth.width(), depth.height(), |x, y| {
        Differences::at(depth, intrinsics, x, y).map_or([0.0; 3], |d| d.normal().as_vec3().to_array())
    })
}

/// Gradient of the depth from the gradient of [`depth_normals`] of the same depth.
///
/// # Panics
/// If the two grids differ in size (a programmer's error).
pub fn depth_normals_backward(depth: &Grid<f32>, intrinsics: &Intrinsics, d_normals: &Grid<[f32; 3]>) -> Grid<f32> {
    assert!(depth.same_size(d_normals), "depth and its normals' gradient differ in size");
    let (width, height) = (depth.width(), depth.height());
    let mut d_depth = Grid::filled(width, height, 0.0f64);
    for y in 0..height {
        for x in 0..width {
            let Some(d) = Differences::at(depth, intrinsics, x, y) else { continue };
            let (d_down, d_right) = d.backward(DVec3::from(d_normals[(x, y)].map(f64::from)));
            d_depth[(x, y + 1)] += ray(intrinsics, x, y + 1).dot(d_down);
            d_depth[(x, y - 1)] -= ray(intrinsics, x, y - 1).dot(d_down);
            d_depth[(x + 1, y)] += ray(intrinsics, x + 1, y).dot(d_right);
            d_depth[(x - 1, y)] -= ray(intrinsics, x - 1, y).dot(d_right);
        }
    }
    d_depth.map(|&d| d as f32)
}

/// Differences of the unprojected neighbours of a pixel.
struct Differences {
    down: DVec3,
    right: DVec3,
}

impl Differences {
    fn at(depth: &Grid<f32>, intrinsics: &Intrinsics, x: usize, y: usize) -> Option<Self> {
        let interior = x > 0 && y > 0 && x + 1 < depth.width() && y + 1 < depth.height();
        if !interior {
            return None;
        }
        let point = |x: usize, y: usize| {
            let z = depth[(x, y)];
            (z.is_finite() && z > 0.0).then(|| ray(intrinsics, x, y) * f64::from(z))
        };
        let out = Self { down: point(x, y + 1)? - point(x, y - 1)?, right: point(x + 1, y)? - point(x - 1, y)? };
        (out.down.cross(out.right).length_squared() > 0.0).then_some(out)
    }

    fn normal(&self) -> DVec3 {
        self.down.cross(self.right).normalize()
    }

    fn backward(&self, d_normal: DVec3) -> (DVec3, DVec3) {
        let product = self.down.cross(self.right);
        let normal = product.normalize();
        let d_product = (d_normal - normal * normal.dot(d_normal)) / product.length();
        (self.right.cross(d_product), d_product.cross(self.down))
    }
}

fn ray(k: &Intrinsics, x: usize, y: usize) -> DVec3 {
    let centre = k.principal_index();
    DVec3::new((x as f64 - centre.x) / k.fx, (y as f64 - centre.y) / k.fy, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const K: Intrinsics = Intrinsics { fx: 31.0, fy: 29.0, cx: 9.5, cy: 7.25 };

    #[test]
    fn a_plane_has_its_own_normal() {
        let normal = DVec3::new(0.3, -0.4, -0.8).normalize();
        let depth = Grid::from_fn(20, 15, |x, y| (-2.0 / normal.dot(ray(&K, x, y))) as f32);
        let normals = depth_normals(&depth, &K);
        for y in 1..14 {
            for x in 1..19 {
                let found = DVec3::from(normals[(x, y)].map(f64::from));
                assert!((found - normal).length() < 1e-5, "{found} at {x},{y}");
            }
        }
        assert_eq!(normals[(0, 5)], [0.0; 3]);
    }

    #[test]
    fn a_hole_has_no_normal_and_no_gradient_around_it() {
        let mut depth = Grid::filled(7, 7, 1.0f32);
        depth[(3, 3)] = 0.0;
        let normals = depth_normals(&depth, &K);
        assert_eq!(normals[(3, 2)], [0.0; 3]);
        assert_ne!(normals[(3, 3)], [0.0; 3]);
        let d_depth = depth_normals_backward(&depth, &K, &Grid::filled(7, 7, [1.0; 3]));
        assert_eq!(d_depth[(3, 3)], 0.0);
    }

    #[test]
    fn gradient_agrees_with_differences() {
        let depth = Grid::from_fn(9, 8, |x, y| 2.0 + 0.1 * (x as f32).sin() + 0.07 * (y as f32 * 1.7).cos());
        let weights =
            Grid::from_fn(9, 8, |x, y| [(x * 5 % 7) as f32 - 3.0, (y * 3 % 5) as f32 - 2.0, ((x + y) % 3) as f32]);
        let loss = |depth: &Grid<f32>| -> f64 {
            let normals = depth_normals(depth, &K);
            let dot = |(n, w): (&[f32; 3], &[f32; 3])| (0..3).map(|c| f64::from(n[c]) * f64::from(w[c])).sum::<f64>();
            normals.as_slice().iter().zip(weights.as_slice()).map(dot).sum()
        };
        let grad = depth_normals_backward(&depth, &K, &weights);
        for (x, y) in [(4, 4), (0, 3), (1, 1), (8, 6), (5, 2)] {
            let step = |h: f32| {
                let mut moved = depth.clone();
                moved[(x, y)] += h;
                loss(&moved)
            };
            let difference = (step(2e-3) - step(-2e-3)) / 4e-3;
            let found = f64::from(grad[(x, y)]);
            assert!((found - difference).abs() < 5e-3 * difference.abs().max(1.0), "{x},{y}: {found} {difference}");
        }
    }
}
