//! A plausible inverse depth where matching has none: behind an occluder, or outside every other view.
//!
//! Hidden surface belongs to what is behind, so the fill continues the farther of the surrounding surfaces.
//! Filled pixels keep a confidence of zero. Invariant: trusted pixels are never changed.

use crate::plane_fit::Plane;
use rayon::prelude::*;
use surfel_core::Grid;

/// The eight directions in which support is sought.
const DIRECTIONS: [(isize, isize); 8] = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)];

/// Replaces the planes of untrusted pixels from the nearest trusted pixel in each of eight directions,
/// preferring those that look alike and, among them, the farther.
pub fn fill_untrusted(planes: &Grid<Plane>, trusted: &Grid<bool>, guide: &Grid<[f32; 3]>) -> Grid<Plane> {
    let width = planes.width();
    let mut filled = planes.clone();
    filled.as_mut_slice().par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            if !trusted[(x, y)]
                && let Some(plane) = surrounding(planes, trusted, guide, x, y)
            {
                *out = plane;
            }
        }
    });
    filled
}

/// Distance, in pixels, over which a neighbouring plane is continued with its slope; beyond, it levels off.
const CONTINUATION_PX: f32 = 16.0;

fn surrounding(
    planes: &Grid<Plane>,
    trusted: &Grid<bool>,
    guide: &Grid<[f32; 3]>,
    x: usize,
    y: usize,
) -> Option<Plane> {
    let own = guide[(x, y)];
    let mut found: Vec<(Plane, f32)> = Vec::with_capacity(8);
    for (dx, dy) in DIRECTIONS {
        let (mut px, mut py) = (x as isize + dx, y as isize + dy);
        let mut distance = 1.0f32;
        while let Some(&is_trusted) = trusted.get(px, py) {
            if is_trusted {
                let at = (px as usize, py as usize);
                let colour_sq: f32 = (0..3).map(|c| (guide[at][c] - own[c]).powi(2)).sum();
                let damping = CONTINUATION_PX / (CONTINUATION_PX + distance);
                let plane = planes[at];
                let w = plane.at(-dx as f32 * distance * damping, -dy as f32 * distance * damping);
                let continued = Plane { w, w_x: plane.w_x * damping, w_y: plane.w_y * damping };
                found.push((continued, 1.0 / ((1.0 + colour_sq / 0.01) * distance)));
                break;
            }
            (px, py, distance) = (px + dx, py + dy, distance + 1.0);
        }
    }
    if found.is_empty() {
        return None;
    }
    // The weighted lower third: behind rather than in front, but not the farthest stray.
    found.sort_by(|a, b| a.0.w.total_cmp(&b.0.w));
    let total: f32 = found.iter().map(|f| f.1).sum();
    let mut sum = 0.0;
    found.iter().find_map(|&(plane, weight)| {
        sum += weight;
        (sum >= total / 3.0).then_some(plane)
    })
}
