//! Where to look: scale-space corners with sub-pixel positions, spread over the image.
//!
//! Extrema of the difference of Gaussians (Lowe 2004, sections 3 to 5), refined by a quadratic fit,
//! without edges, each with one or two dominant gradient directions. The invariant: the order and
//! the number of keypoints depend on the pixels only, never on the number of threads.

use crate::pyramid::{LEVELS_PER_OCTAVE, Octave};
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use std::f32::consts::TAU;
use surfel_core::Grid;

/// Weakest accepted response of the difference of Gaussians, for gray values in \[0, 1\]. Lower than
/// Lowe's 0.03: [`spread`] keeps the strongest anyway, and plain walls have little else.
const MIN_CONTRAST: f64 = 0.008;
/// Largest accepted ratio of principal curvatures: above it the point slides along an edge (Lowe 2004, section 4.1).
const MAX_EDGE_RATIO: f64 = 10.0;
/// Octave pixels left free at the border, so that gradients exist.
const BORDER: usize = 5;
/// Bins of the orientation histogram (Lowe 2004, section 5).
const NUM_DIRECTIONS: usize = 36;
/// Cells per image side in [`spread`].
const CELLS_PER_SIDE: f64 = 16.0;

/// A corner with a scale and a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keypoint {
    /// Continuous image pixel.
    pub position: DVec2,
    /// Blur at which it stands out, image pixels.
    pub sigma: f64,
    /// Dominant gradient direction, radians, from +x towards +y.
    pub angle: f32,
    /// Strength of the difference of Gaussians, gray units.
    pub response: f64,
    /// Octave it was found in.
    pub(crate) octave: usize,
    /// Octave index coordinates.
    pub(crate) index: DVec2,
    /// Fractional level in the octave.
    pub(crate) level: f64,
}

/// Finds the keypoints of all octaves, unsorted by strength, in raster order.
pub fn detect(octaves: &[Octave]) -> Vec<Keypoint> {
    let mut keypoints = Vec::new();
    for (o, octave) in octaves.iter().enumerate() {
        let differences: Vec<Grid<f32>> =
            octave.levels.par_windows(2).map(|pair| difference(&pair[1], &pair[0])).collect();
        let (width, height) = (differences[0].width(), differences[0].height());
        for s in 1..=LEVELS_PER_OCTAVE {
            let rows: Vec<Vec<Keypoint>> = (BORDER..height - BORDER)
                .into_par_iter()
                .map(|y| {
                    let corners = (BORDER..width - BORDER).filter(|&x| is_extremum(&differences, s, x, y));
                    corners.filter_map(|x| refine(&differences, octave, o, s, x, y)).collect()
                })
                .collect();
            keypoints.extend(rows.into_iter().flatten());
        }
    }
    keypoints
}

/// Keeps at most `max_count`, first the strongest of every cell of a 16 x 16 grid, then the second
/// strongest of every cell, and so on: an even cover that still prefers strong corners.
pub fn spread(mut keypoints: Vec<Keypoint>, size: (usize, usize), max_count: usize) -> Vec<Keypoint> {
    let strongest_first = |a: &Keypoint, b: &Keypoint| b.response.total_cmp(&a.response);
    keypoints.sort_by(strongest_first);
    let cell_size = DVec2::new(size.0 as f64, size.1 as f64) / CELLS_PER_SIDE;
    let num_cells = (CELLS_PER_SIDE * CELLS_PER_SIDE) as usize;
    let mut taken = vec![0usize; num_cells];
    let mut ranked: Vec<(usize, Keypoint)> = keypoints
        .into_iter()
        .map(|keypoint| {
            let cell = (keypoint.position / cell_size).floor().clamp(DVec2::ZERO, DVec2::splat(CELLS_PER_SIDE - 1.0));
            let count = &mut taken[(cell.y * CELLS_PER_SIDE + cell.x) as usize];
            *count += 1;
            (*count, keypoint)
        })
        .collect();
    ranked.sort_by_key(|(rank, _)| *rank);
    ranked.into_iter().take(max_count).map(|(_, keypoint)| keypoint).collect()
}

/// Copies each keypoint once per dominant gradient direction (every histogram peak above 80 % of the
/// highest; Lowe 2004, section 5).
pub fn oriented(keypoints: &[Keypoint], octaves: &[Octave]) -> Vec<Keypoint> {
    let copies: Vec<Vec<Keypoint>> = keypoints
        .par_iter()
        .map(|keypoint| {
            let angles = dominant_angles(keypoint, &octaves[keypoint.octave]);
            angles.into_iter().map(|angle| Keypoint { angle, ..*keypoint }).collect()
        })
        .collect();
    copies.into_iter().flatten().collect()
}

fn difference(a: &Grid<f32>, b: &Grid<f32>) -> Grid<f32> {
    let data = a.as_slice().iter().zip(b.as_slice()).map(|(a, b)| a - b).collect();
    Grid::from_vec(a.width(), a.height(), data)
}

fn is_extremum(differences: &[Grid<f32>], s: usize, x: usize, y: usize) -> bool {
    let value = differences[s][(x, y)];
    // The fit can raise a response by about half at most, so weaker ones cannot pass `MIN_CONTRAST`.
    if value.abs() < 0.5 * MIN_CONTRAST as f32 {
        return false;
    }
    let sign = value.signum();
    let mut others = 0;
    for grid in &differences[s - 1..=s + 1] {
        for row in y - 1..=y + 1 {
            others += grid.row(row)[x - 1..=x + 1].iter().filter(|&&v| sign * v >= sign * value).count();
        }
    }
    others == 1
}

fn refine(
    differences: &[Grid<f32>],
    octave: &Octave,
    octave_index: usize,
    s: usize,
    x: usize,
    y: usize,
) -> Option<Keypoint> {
    let (width, height) = (differences[0].width(), differences[0].height());
    let (mut s, mut x, mut y) = (s, x, y);
    for _ in 0..5 {
        let at = |ds: isize, dx: isize, dy: isize| {
            let level = &differences[s.wrapping_add_signed(ds)];
            level[(x.wrapping_add_signed(dx), y.wrapping_add_signed(dy))] as f64
        };
        let value = at(0, 0, 0);
        let gradient =
            0.5 * DVec3::new(at(0, 1, 0) - at(0, -1, 0), at(0, 0, 1) - at(0, 0, -1), at(1, 0, 0) - at(-1, 0, 0));
        let xx = at(0, 1, 0) + at(0, -1, 0) - 2.0 * value;
        let yy = at(0, 0, 1) + at(0, 0, -1) - 2.0 * value;
        let ss = at(1, 0, 0) + at(-1, 0, 0) - 2.0 * value;
        let xy = 0.25 * (at(0, 1, 1) + at(0, -1, -1) - at(0, 1, -1) - at(0, -1, 1));
        let xs = 0.25 * (at(1, 1, 0) + at(-1, -1, 0) - at(1, -1, 0) - at(-1, 1, 0));
        let ys = 0.25 * (at(1, 0, 1) + at(-1, 0, -1) - at(1, 0, -1) - at(-1, 0, 1));
        let hessian = DMat3::from_cols(DVec3::new(xx, xy, xs), DVec3::new(xy, yy, ys), DVec3::new(xs, ys, ss));
        let offset = -(hessian.inverse() * gradient);
        if !offset.is_finite() {
            return None;
        }
        if offset.abs().max_element() > 0.6 {
            let step = offset.clamp(DVec3::splat(-1.0), DVec3::splat(1.0)).round();
            x = x.wrapping_add_signed(step.x as isize);
            y = y.wrapping_add_signed(step.y as isize);
            s = s.wrapping_add_signed(step.z as isize);
            let inside = (1..=LEVELS_PER_OCTAVE).contains(&s)
                && (BORDER..width - BORDER).contains(&x)
                && (BORDER..height - BORDER).contains(&y);
            if !inside {
                return None;
            }
            continue;
        }
        let response = (value + 0.5 * gradient.dot(offset)).abs();
        let (trace, determinant) = (xx + yy, xx * yy - xy * xy);
        let on_edge =
            determinant <= 0.0 || trace * trace * MAX_EDGE_RATIO >= (MAX_EDGE_RATIO + 1.0).powi(2) * determinant;
        if response < MIN_CONTRAST || on_edge {
            return None;
        }
        let index = DVec2::new(x as f64 + offset.x, y as f64 + offset.y);
        let level = s as f64 + offset.z;
        return Some(Keypoint {
            position: DVec2::new(octave.to_image(index.x), octave.to_image(index.y)),
            sigma: Octave::sigma(level) * octave.step,
            angle: 0.0,
            response,
            octave: octave_index,
            index,
            level,
        });
    }
    None
}

fn dominant_angles(keypoint: &Keypoint, octave: &Octave) -> Vec<f32> {
    let level = &octave.levels[nearest_level(keypoint)];
    let sigma = 1.5 * Octave::sigma(keypoint.level);
    let radius = (3.0 * sigma).round() as isize;
    let (cx, cy) = (keypoint.index.x.round() as isize, keypoint.index.y.round() as isize);
    let mut histogram = [0.0f32; NUM_DIRECTIONS];
    for y in (cy - radius).max(1)..=(cy + radius).min(level.height() as isize - 2) {
        for x in (cx - radius).max(1)..=(cx + radius).min(level.width() as isize - 2) {
            let (x_at, y_at) = (x as usize, y as usize);
            let dx = level[(x_at + 1, y_at)] - level[(x_at - 1, y_at)];
            let dy = level[(x_at, y_at + 1)] - level[(x_at, y_at - 1)];
            let away_sq = (x as f64 - keypoint.index.x).powi(2) + (y as f64 - keypoint.index.y).powi(2);
            let weight = (-away_sq / (2.0 * sigma * sigma)).exp() as f32;
            let turn = dy.atan2(dx) / TAU * NUM_DIRECTIONS as f32;
            let bin = turn.rem_euclid(NUM_DIRECTIONS as f32) as usize % NUM_DIRECTIONS;
            histogram[bin] += weight * dx.hypot(dy);
        }
    }
    for _ in 0..2 {
        let raw = histogram;
        for i in 0..NUM_DIRECTIONS {
            let (before, after) = (raw[(i + NUM_DIRECTIONS - 1) % NUM_DIRECTIONS], raw[(i + 1) % NUM_DIRECTIONS]);
            histogram[i] = 0.25 * before + 0.5 * raw[i] + 0.25 * after;
        }
    }
    let highest = histogram.iter().copied().fold(0.0f32, f32::max);
    let mut peaks: Vec<(f32, f32)> = (0..NUM_DIRECTIONS)
        .filter_map(|i| {
            let (before, here, after) = (
                histogram[(i + NUM_DIRECTIONS - 1) % NUM_DIRECTIONS],
                histogram[i],
                histogram[(i + 1) % NUM_DIRECTIONS],
            );
            let is_peak = here > before && here >= after && here >= 0.8 * highest;
            let offset = 0.5 * (before - after) / (before - 2.0 * here + after);
            is_peak.then(|| (here, (i as f32 + 0.5 + offset) * TAU / NUM_DIRECTIONS as f32))
        })
        .collect();
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    peaks.truncate(2);
    peaks.into_iter().map(|(_, angle)| angle).collect()
}

/// The pyramid level whose blur is nearest to the keypoint's.
pub(crate) fn nearest_level(keypoint: &Keypoint) -> usize {
    (keypoint.level.round() as usize).clamp(1, LEVELS_PER_OCTAVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pyramid::octaves;

    fn blob(centre: DVec2, sigma: f64) -> Grid<f32> {
        Grid::from_fn(96, 80, |x, y| {
            let away_sq = (DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - centre).length_squared();
            0.2 + 0.6 * (-away_sq / (2.0 * sigma * sigma)).exp() as f32
        })
    }

    #[test]
    fn a_blob_is_found_at_its_centre_and_scale() {
        for (centre, sigma) in [(DVec2::new(40.3, 33.7), 2.5), (DVec2::new(51.9, 44.1), 4.0)] {
            let octaves = octaves(&blob(centre, sigma));
            let found = detect(&octaves);
            let best = found.iter().max_by(|a, b| a.response.total_cmp(&b.response)).expect("the blob is a keypoint");
            assert!((best.position - centre).length() < 0.1, "{best:?}");
            assert!((best.sigma / sigma - 1.0).abs() < 0.3, "{best:?}");
        }
    }

    #[test]
    fn a_plain_image_and_a_straight_edge_have_no_keypoint() {
        let edge = Grid::from_fn(96, 80, |x, _| if x < 48 { 0.1f32 } else { 0.9 });
        assert!(detect(&octaves(&edge)).is_empty());
        assert!(detect(&octaves(&Grid::filled(96, 80, 0.5f32))).is_empty());
    }

    #[test]
    fn spreading_serves_every_cell_before_any_cell_twice() {
        let at = |x: f64, response: f64| Keypoint {
            position: DVec2::new(x, 8.0),
            sigma: 1.0,
            angle: 0.0,
            response,
            octave: 0,
            index: DVec2::ZERO,
            level: 1.0,
        };
        let kept = spread(vec![at(5.0, 9.0), at(6.0, 8.0), at(150.0, 0.1)], (160, 160), 2);
        assert_eq!(kept.iter().map(|k| k.position.x).collect::<Vec<_>>(), [5.0, 150.0]);
    }
}
