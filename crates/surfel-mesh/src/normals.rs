//! Normals of a depth map up to its rim.
//!
//! The central differences of [`surfel_core::normals`] end one pixel before the rim, and the pixels along the
//! rim of an object are just those seen at the steepest angles. Here a missing neighbour leaves a one-sided
//! difference. Invariant: a normal exists wherever each axis has a neighbour with depth.

use crate::view::is_depth;
use surfel_core::{Grid, Intrinsics, normals::normal_from_gradient};

/// Unit normal per pixel, camera frame, facing the camera; `None` without depth, or without any neighbour
/// along an axis.
pub fn normals_to_the_rim(depth: &Grid<f32>, intrinsics: &Intrinsics) -> Grid<Option<[f32; 3]>> {
    Grid::from_fn(depth.width(), depth.height(), |x, y| {
        let here = depth_at(depth, x as isize, y as isize)?;
        let slope = |dx: isize, dy: isize| {
            let (x, y) = (x as isize, y as isize);
            match (depth_at(depth, x - dx, y - dy), depth_at(depth, x + dx, y + dy)) {
                (Some(before), Some(after)) => Some((after - before) / 2.0),
                (None, Some(after)) => Some(after - here),
                (Some(before), None) => Some(here - before),
                (None, None) => None,
            }
        };
        Some(normal_from_gradient(intrinsics, x as f64, y as f64, here, slope(1, 0)?, slope(0, 1)?))
    })
}

fn depth_at(depth: &Grid<f32>, x: isize, y: isize) -> Option<f64> {
    depth.get(x, y).copied().filter(|&z| is_depth(z)).map(f64::from)
}
