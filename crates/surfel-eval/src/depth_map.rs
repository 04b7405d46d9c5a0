//! A depth map together with the intrinsics it was sampled with, and how to read it between pixels.
//!
//! Everything that compares depth maps of different sizes goes through [`DepthMap::lookup`], so that all
//! scores share one rule at depth edges. Invariant: a lookup never blends two surfaces.

use glam::DVec2;
use surfel_core::{Grid, Intrinsics};

/// Depths closer to each other than this (larger over smaller) belong to one surface; a greater step
/// between neighbours is a depth edge.
pub const EDGE_RATIO: f32 = 1.02;

/// A borrowed z-depth map, scene units, 0 (or anything not finite and positive) = no depth.
#[derive(Clone, Copy, Debug)]
pub struct DepthMap<'a> {
    /// z-depth per pixel.
    pub depth: &'a Grid<f32>,
    /// Intrinsics in pixels of `depth`.
    pub intrinsics: &'a Intrinsics,
}

impl<'a> DepthMap<'a> {
    /// Joins a depth map and its intrinsics.
    pub fn new(depth: &'a Grid<f32>, intrinsics: &'a Intrinsics) -> Self {
        Self { depth, intrinsics }
    }

    /// The continuous pixel of this map that looks along the same ray as continuous pixel `pixel` of
    /// another map of the same camera.
    pub fn pixel_from(&self, pixel: DVec2, other: &Intrinsics) -> DVec2 {
        let k = self.intrinsics;
        DVec2::new((pixel.x - other.cx) / other.fx * k.fx + k.cx, (pixel.y - other.cy) / other.fy * k.fy + k.cy)
    }

    /// Depth at a continuous pixel: bilinear where the four surrounding pixels all have depth and lie on
    /// one surface ([`EDGE_RATIO`]), else that of the pixel the point falls into; `None` without depth
    /// there or outside the image.
    pub fn lookup(&self, pixel: DVec2) -> Option<f32> {
        let (x, y) = (pixel.x.floor() as isize, pixel.y.floor() as isize);
        let nearest = *self.depth.get(x, y)?;
        if !is_depth(nearest) {
            return None;
        }
        let index = pixel - DVec2::splat(0.5);
        let (x0, y0) = (index.x.floor() as isize, index.y.floor() as isize);
        let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| self.depth.get(x0 + dx, y0 + dy).copied());
        let (mut low, mut high) = (f32::INFINITY, 0.0f32);
        for corner in corners {
            let Some(z) = corner.filter(|&z| is_depth(z)) else {
                return Some(nearest);
            };
            (low, high) = (low.min(z), high.max(z));
        }
        if high > low * EDGE_RATIO {
            return Some(nearest);
        }
        self.depth.bilinear(index.x, index.y)
    }
}

/// True for a value that means a depth: finite and positive.
pub fn is_depth(z: f32) -> bool {
    z.is_finite() && z > 0.0
}

/// The depth map with every pixel outside `mask` set to "no depth": scores an object instead of the picture.
///
/// # Panics
/// If the two differ in size.
pub fn restricted_to(depth: &Grid<f32>, mask: &Grid<bool>) -> Grid<f32> {
    assert!(depth.same_size(mask), "depth map and mask differ in size");
    let kept = depth.as_slice().iter().zip(mask.as_slice()).map(|(&z, &inside)| if inside { z } else { 0.0 });
    Grid::from_vec(depth.width(), depth.height(), kept.collect())
}

/// The depth map as a camera with `intrinsics` and `width` x `height` pixels would have measured it.
///
/// A coarser raster averages the source pixels in each of its pixels (those on the surface of the central
/// one), so that measurement noise shrinks as it does in a resized photograph; a finer one looks up.
pub fn resampled(source: DepthMap, intrinsics: &Intrinsics, width: usize, height: usize) -> Grid<f32> {
    let raster = DepthMap::new(source.depth, source.intrinsics);
    Grid::from_fn(width, height, |x, y| {
        let corner = |dx: f64, dy: f64| raster.pixel_from(DVec2::new(x as f64 + dx, y as f64 + dy), intrinsics);
        let Some(centre) = source.lookup(corner(0.5, 0.5)) else {
            return 0.0;
        };
        let (low, high) = (corner(0.0, 0.0), corner(1.0, 1.0));
        // Source pixels whose centres lie inside the target pixel.
        let span = |low: f64, high: f64| ((low - 0.5).ceil() as isize, (high - 0.5).ceil() as isize);
        let ((x0, x1), (y0, y1)) = (span(low.x, high.x), span(low.y, high.y));
        let (mut sum, mut count) = (0.0f64, 0usize);
        for sy in y0..y1 {
            for sx in x0..x1 {
                if let Some(&z) = source.depth.get(sx, sy)
                    && is_depth(z)
                    && z.max(centre) <= z.min(centre) * EDGE_RATIO
                {
                    (sum, count) = (sum + f64::from(z), count + 1);
                }
            }
        }
        if count == 0 { centre } else { (sum / count as f64) as f32 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(width: usize, height: usize, k: &Intrinsics, tilt: f64) -> Grid<f32> {
        Grid::from_fn(width, height, |x, y| {
            let ray_x = (x as f64 + 0.5 - k.cx) / k.fx;
            let ray_y = (y as f64 + 0.5 - k.cy) / k.fy;
            (5.0 / (1.0 + tilt * ray_x - 0.5 * tilt * ray_y)) as f32
        })
    }

    #[test]
    fn a_plane_reads_the_same_at_every_resolution() {
        let fine_k = Intrinsics { fx: 400.0, fy: 390.0, cx: 161.0, cy: 119.0 };
        let coarse_k = Intrinsics { fx: 160.0, fy: 156.0, cx: 64.4, cy: 47.6 };
        let fine = plane(320, 240, &fine_k, 0.6);
        let coarse = plane(128, 96, &coarse_k, 0.6);
        let down = resampled(DepthMap::new(&fine, &fine_k), &coarse_k, 128, 96);
        for (a, b) in down.as_slice().iter().zip(coarse.as_slice()) {
            assert!((a - b).abs() < 2e-3 * b, "{a} against {b}");
        }
        let map = DepthMap::new(&coarse, &coarse_k);
        for (x, y) in [(20usize, 31usize), (200, 100), (300, 222)] {
            let z = map.lookup(map.pixel_from(DVec2::new(x as f64 + 0.5, y as f64 + 0.5), &fine_k)).unwrap();
            assert!((z - fine[(x, y)]).abs() < 1e-4 * z);
        }
    }

    #[test]
    fn an_edge_is_never_blended_and_a_hole_stays_a_hole() {
        let k = Intrinsics { fx: 10.0, fy: 10.0, cx: 2.0, cy: 1.0 };
        let depth = Grid::from_vec(4, 2, vec![1.0, 1.0, 2.0, 0.0, 1.0, 1.0, 2.0, 0.0]);
        let map = DepthMap::new(&depth, &k);
        assert_eq!(map.lookup(DVec2::new(1.9, 1.0)), Some(1.0));
        assert_eq!(map.lookup(DVec2::new(2.1, 1.0)), Some(2.0));
        assert_eq!(map.lookup(DVec2::new(2.9, 1.0)), Some(2.0));
        assert_eq!(map.lookup(DVec2::new(3.1, 1.0)), None);
        assert_eq!(map.lookup(DVec2::new(-0.1, 1.0)), None);
    }
}
