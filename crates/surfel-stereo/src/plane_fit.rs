//! A local plane through noisy inverse depths: moving least squares, edge-aware.
//!
//! A plane in space is affine in inverse depth, `w(x, y) = a + b x + c y`, so fitting one is a 3x3 linear
//! system per pixel and bends with no perspective. Invariant: an exact plane is reproduced exactly.

use crate::config::Refinement;
use rayon::prelude::*;
use surfel_core::Grid;

/// Inverse depth at a pixel and its change per pixel to the right and down.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Plane {
    /// Inverse depth at the pixel.
    pub w: f32,
    /// `dw/dx` per pixel.
    pub w_x: f32,
    /// `dw/dy` per pixel.
    pub w_y: f32,
}

impl Plane {
    /// Inverse depth `(dx, dy)` pixels away.
    pub fn at(&self, dx: f32, dy: f32) -> f32 {
        self.w + self.w_x * dx + self.w_y * dy
    }
}

/// A pixel's evidence: an inverse depth and how much it may be trusted (0 = ignore).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evidence {
    /// Inverse depth.
    pub w: f32,
    /// Weight, >= 0.
    pub weight: f32,
}

/// Where a fit looks, nearest first: every pixel close by, then ever sparser rings.
///
/// The weight falls slowly with distance, and the more slowly the weaker the evidence nearby is: texture is
/// followed closely, a bare wall is averaged widely.
struct Neighbourhood {
    offsets: Vec<(isize, isize, f32)>,
    /// Squared distance at which a neighbour's weight has halved where evidence is strong, pixels².
    reach_sq: f32,
}

impl Neighbourhood {
    fn new(config: &Refinement) -> Self {
        let radius = config.fit_radius as isize;
        let far = radius * config.fit_reach as isize;
        let mut offsets = Vec::new();
        for dy in -far..=far {
            for dx in -far..=far {
                let distance_sq = dx * dx + dy * dy;
                let stride = match distance_sq {
                    d if d <= radius * radius => 1,
                    d if d <= 4 * radius * radius => 3,
                    d if d <= far * far => 6,
                    _ => continue,
                };
                if dx % stride == 0 && dy % stride == 0 {
                    offsets.push((dx, dy, distance_sq as f32));
                }
            }
        }
        Self { offsets, reach_sq: ((radius * radius) as f32 / 2.0).max(1.0) }
    }
}

/// Fits a plane around every pixel.
///
/// `current` is what the surface is believed to be; neighbours that disagree with its extrapolation by
/// more than about `tolerance` (inverse depth) belong to another surface and lose their weight.
pub fn fit_planes(
    evidence: &Grid<Evidence>,
    current: &Grid<Plane>,
    guide: &Grid<[f32; 3]>,
    tolerance: f32,
    config: &Refinement,
) -> Grid<Plane> {
    let (width, height) = (evidence.width(), evidence.height());
    let neighbourhood = Neighbourhood::new(config);
    let strength = local_strength(evidence);
    let mut planes = Grid::filled(width, height, Plane::default());
    planes.as_mut_slice().par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            let reach_sq =
                neighbourhood.reach_sq * (STRONG / strength[(x, y)].max(1e-6)).clamp(1.0, config.fit_widening);
            *out =
                fit_plane(evidence, current[(x, y)], guide, tolerance, config, &neighbourhood.offsets, reach_sq, x, y);
        }
    });
    planes
}

/// Evidence weight of well-textured pixels.
const STRONG: f32 = 0.25;

/// Mean evidence weight of the 5x5 pixels around each pixel.
fn local_strength(evidence: &Grid<Evidence>) -> Grid<f32> {
    Grid::from_fn(evidence.width(), evidence.height(), |x, y| {
        let around = (-2..=2isize).flat_map(|dy| (-2..=2isize).map(move |dx| (dx, dy)));
        around.filter_map(|(dx, dy)| evidence.get(x as isize + dx, y as isize + dy)).map(|e| e.weight).sum::<f32>()
            / 25.0
    })
}

fn fit_plane(
    evidence: &Grid<Evidence>,
    current: Plane,
    guide: &Grid<[f32; 3]>,
    tolerance: f32,
    config: &Refinement,
    offsets: &[(isize, isize, f32)],
    reach_sq: f32,
    x: usize,
    y: usize,
) -> Plane {
    let own = guide[(x, y)];
    let inverse_edge_sq = 1.0 / (config.fit_edge * config.fit_edge);
    let inverse_tolerance_sq = 1.0 / (tolerance * tolerance);
    // Normal equations of residuals r = w - current.at(dx, dy), which keeps the numbers small.
    let mut m = [0.0f32; 6];
    let mut v = [0.0f32; 3];
    let inverse_reach_sq = 1.0 / reach_sq;
    for &(dx, dy, distance_sq) in offsets {
        let (px, py) = (x as isize + dx, y as isize + dy);
        let Some(q) = evidence.get(px, py).filter(|q| q.weight > 0.0) else { continue };
        let (dx, dy) = (dx as f32, dy as f32);
        let residual = q.w - current.at(dx, dy);
        let colour = guide[(px as usize, py as usize)];
        let colour_sq: f32 = (0..3).map(|c| (colour[c] - own[c]) * (colour[c] - own[c])).sum();
        let alike = 1.0 / (1.0 + colour_sq * inverse_edge_sq);
        let agree = 1.0 / (1.0 + residual * residual * inverse_tolerance_sq);
        let near = 1.0 / (1.0 + distance_sq * inverse_reach_sq);
        let weight = q.weight * near * alike * alike * agree * agree;
        m[0] += weight;
        m[1] += weight * dx;
        m[2] += weight * dy;
        m[3] += weight * dx * dx;
        m[4] += weight * dx * dy;
        m[5] += weight * dy * dy;
        v[0] += weight * residual;
        v[1] += weight * residual * dx;
        v[2] += weight * residual * dy;
    }
    let correction = solve_symmetric(m, v);
    Plane { w: current.w + correction[0], w_x: current.w_x + correction[1], w_y: current.w_y + correction[2] }
}

/// Solves the symmetric 3x3 system `[[m0 m1 m2] [m1 m3 m4] [m2 m4 m5]] s = v`; falls back to the mean
/// offset when the neighbours do not span a plane.
fn solve_symmetric(m: [f32; 6], v: [f32; 3]) -> [f32; 3] {
    if m[0] <= 1e-12 {
        return [0.0; 3];
    }
    let [a, b, c, d, e, f] = m.map(|x| f64::from(x / m[0]));
    let v = v.map(|x| f64::from(x / m[0]));
    // A slope needs neighbours at least a fraction of a pixel to the side on both axes.
    let ridge = 1e-3;
    let (d, f) = (d + ridge, f + ridge);
    let (c00, c01, c02) = (d * f - e * e, c * e - b * f, b * e - c * d);
    let determinant = a * c00 + b * c01 + c * c02;
    if determinant <= 1e-4 {
        return [v[0] as f32, 0.0, 0.0];
    }
    let (c11, c12, c22) = (a * f - c * c, b * c - a * e, a * d - b * b);
    let s = |x: f64, y: f64, z: f64| ((x * v[0] + y * v[1] + z * v[2]) / determinant) as f32;
    [s(c00, c01, c02), s(c01, c11, c12), s(c02, c12, c22)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_reproduced() {
        let truth = |x: usize, y: usize| 0.5 + 0.003 * x as f32 - 0.002 * y as f32;
        let evidence = Grid::from_fn(20, 16, |x, y| Evidence { w: truth(x, y), weight: 1.0 });
        let current = Grid::from_fn(20, 16, |x, y| Plane { w: truth(x, y) + 0.001, w_x: 0.0, w_y: 0.0 });
        let guide = Grid::filled(20, 16, [0.5; 3]);
        let mut planes = current;
        for _ in 0..4 {
            planes = fit_planes(&evidence, &planes, &guide, 0.02, &Refinement::default());
        }
        for y in 0..16 {
            for x in 0..20 {
                let p = planes[(x, y)];
                assert!((p.w - truth(x, y)).abs() < 1e-5, "{p:?} at {x},{y}");
                assert!((p.w_x - 0.003).abs() < 2e-5 && (p.w_y + 0.002).abs() < 2e-5, "{p:?}");
            }
        }
    }

    #[test]
    fn two_surfaces_stay_apart() {
        let truth = |x: usize| if x < 10 { 0.5 } else { 0.9 };
        let evidence = Grid::from_fn(20, 16, |x, _| Evidence { w: truth(x), weight: 1.0 });
        let current = Grid::from_fn(20, 16, |x, _| Plane { w: truth(x), w_x: 0.0, w_y: 0.0 });
        let guide = Grid::filled(20, 16, [0.5; 3]);
        let planes = fit_planes(&evidence, &current, &guide, 0.01, &Refinement::default());
        assert!((0..20).all(|x| (planes[(x, 8)].w - truth(x)).abs() < 2e-3));
    }
}
