//! The proof of a rendered pair: one view, warped by its depth, must look like the other.
//!
//! Tests camera, depth and image against each other with no knowledge of how they were made; also for
//! real data with reference depth. Invariant: pixels hidden from the other view are left out by depth,
//! never by colour.

use crate::render::RenderedView;
use surfel_core::{Camera, Grid};

/// How well one view explains another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WarpStatistics {
    /// Pixels with depth.
    pub num_with_depth: usize,
    /// Those that the other view sees, unoccluded.
    pub num_compared: usize,
    /// Gain per channel that best maps the other view's sRGB values to this one's (exposure, white balance).
    pub gain: [f32; 3],
    /// Mean absolute difference after the gain, sRGB units.
    pub mean: f32,
    /// Median absolute difference after the gain.
    pub median: f32,
    /// 90th percentile of the absolute difference after the gain.
    pub p90: f32,
}

/// Looks up every pixel of `target` in `source` through `target`'s depth and compares colours.
///
/// A pixel counts as seen by `source` when all four depths around its projection agree with it within
/// `depth_tolerance` (relative; 0.01 is a good value).
pub fn warp_statistics(target: &RenderedView, source: &RenderedView, depth_tolerance: f32) -> WarpStatistics {
    let camera = &target.view.camera;
    let mut pairs: Vec<([f32; 3], [f32; 3])> = Vec::new();
    let mut num_with_depth = 0;
    for y in 0..camera.height {
        for x in 0..camera.width {
            let depth = target.depth[(x, y)];
            if depth <= 0.0 {
                continue;
            }
            num_with_depth += 1;
            let world = camera.unproject(Camera::pixel_centre(x, y), f64::from(depth));
            let Some((pixel, z)) = source.view.camera.project(world) else {
                continue;
            };
            let (u, v) = (pixel.x - 0.5, pixel.y - 0.5);
            let close = |d: f32| (d - z as f32).abs() <= depth_tolerance * z as f32;
            if four_around(&source.depth, u, v).is_some_and(|depths| depths.into_iter().all(close))
                && let Some(colour) = bilinear(&source.view.image, u, v)
            {
                pairs.push((target.view.image[(x, y)], colour));
            }
        }
    }
    let gain: [f32; 3] = std::array::from_fn(|c| {
        let (cross, power) = pairs
            .iter()
            .fold((0.0f64, 1e-12f64), |(ab, bb), (a, b)| (ab + f64::from(a[c] * b[c]), bb + f64::from(b[c] * b[c])));
        (cross / power) as f32
    });
    let difference = |(a, b): &([f32; 3], [f32; 3])| (0..3).map(|c| (a[c] - gain[c] * b[c]).abs()).sum::<f32>() / 3.0;
    let mut errors: Vec<f32> = pairs.iter().map(difference).collect();
    errors.sort_by(f32::total_cmp);
    let quantile = |q: f64| errors.get((q * errors.len() as f64) as usize).copied().unwrap_or(f32::NAN);
    let mean = (errors.iter().map(|&e| f64::from(e)).sum::<f64>() / errors.len() as f64) as f32;
    WarpStatistics { num_with_depth, num_compared: pairs.len(), gain, mean, median: quantile(0.5), p90: quantile(0.9) }
}

/// The four pixels around index coordinates `(u, v)`, or `None` outside the hull of the pixel centres.
fn four_around<T: Copy>(grid: &Grid<T>, u: f64, v: f64) -> Option<[T; 4]> {
    let (x, y) = (u.floor() as isize, v.floor() as isize);
    Some([*grid.get(x, y)?, *grid.get(x + 1, y)?, *grid.get(x, y + 1)?, *grid.get(x + 1, y + 1)?])
}

fn bilinear(image: &Grid<[f32; 3]>, u: f64, v: f64) -> Option<[f32; 3]> {
    let [a, b, c, d] = four_around(image, u, v)?;
    let (s, t) = ((u - u.floor()) as f32, (v - v.floor()) as f32);
    Some(std::array::from_fn(|i| (a[i] * (1.0 - s) + b[i] * s) * (1.0 - t) + (c[i] * (1.0 - s) + d[i] * s) * t))
}
