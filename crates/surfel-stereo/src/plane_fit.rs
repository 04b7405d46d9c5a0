//! A local plane through noisy inverse depths: moving least squares, edge-aware.
//!
//! A plane in space is affine in inverse depth, `w(x, y) = a + b x + c y`, so fitting one is a 3x3 linear
//! system per pixel and bends with no perspective. Invariant: an exact plane is reproduced exactly.

use crate::config::Refinement;
pub(crate) use crate::normal_equations::solve_symmetric;
use crate::normal_equations::{FitRow, Layers, Reach, Row, STRENGTH_RADIUS, runs};
use pulp::Arch;
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

/// Where a fit looks, row by row: every pixel close by, then ever sparser rings.
///
/// The weight falls slowly with distance, and the more slowly the weaker the evidence nearby is ([`Reach`]): texture
/// is followed closely, a bare wall is averaged widely.
pub(crate) fn neighbourhood(config: &Refinement) -> Vec<(isize, isize)> {
    let radius = config.fit_radius as isize;
    let far = radius * config.fit_reach as isize;
    let mut offsets = Vec::new();
    for dy in -far..=far {
        for dx in -far..=far {
            let stride = match dx * dx + dy * dy {
                d if d <= radius * radius => 1,
                d if d <= 4 * radius * radius => 3,
                d if d <= far * far => 6,
                _ => continue,
            };
            if dx % stride == 0 && dy % stride == 0 {
                offsets.push((dx, dy));
            }
        }
    }
    offsets
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
    let offsets = neighbourhood(config);
    let farthest = offsets.iter().map(|&(dx, dy)| dx.abs().max(dy.abs())).max().unwrap_or(0);
    let layers = Layers::new(evidence, guide, STRENGTH_RADIUS.max(farthest as usize));
    let runs = runs(&offsets, &layers.layout);
    let arch = Arch::new();
    let mut planes = current.clone();
    planes.as_mut_slice().par_chunks_mut(evidence.width()).enumerate().for_each_init(
        Row::default,
        |row, (y, planes)| {
            arch.dispatch(FitRow {
                layers: &layers,
                runs: &runs,
                y,
                reach: reach(config),
                inverse_tolerance_sq: 1.0 / (tolerance * tolerance),
                inverse_edge_sq: 1.0 / (config.fit_edge * config.fit_edge),
                row,
                planes,
            });
        },
    );
    planes
}

/// How far a fit reaches.
pub(crate) fn reach(config: &Refinement) -> Reach {
    Reach { strong_sq: ((config.fit_radius * config.fit_radius) as f32 / 2.0).max(1.0), widening: config.fit_widening }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin;

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

    #[test]
    fn equals_the_twin() {
        // Odd sizes, smaller than the reach of the fit, so that every kind of border is met.
        let (width, height) = (37, 21);
        let noise = |x: usize, y: usize, seed: usize| ((x * 7919 + y * 104_729 + seed * 31) % 1009) as f32 / 1009.0;
        let evidence = Grid::from_fn(width, height, |x, y| Evidence {
            w: 0.5 + 0.02 * noise(x, y, 1),
            weight: (noise(x, y, 2) - 0.3).max(0.0),
        });
        let current = Grid::from_fn(width, height, |x, y| Plane {
            w: 0.5 + 0.02 * noise(x, y, 3),
            w_x: 1e-3 * noise(x, y, 4),
            w_y: -1e-3 * noise(x, y, 5),
        });
        let guide = Grid::from_fn(width, height, |x, y| [6, 7, 8].map(|seed| 0.3 * noise(x, y, seed)));
        let config = Refinement::default();
        let planes = fit_planes(&evidence, &current, &guide, 0.01, &config);
        for y in 0..height {
            for x in 0..width {
                let slow = twin::fit_plane(&evidence, current[(x, y)], &guide, 0.01, &config, (x, y));
                let fast = planes[(x, y)];
                let apart = [fast.w - slow.w, fast.w_x - slow.w_x, fast.w_y - slow.w_y];
                assert!(apart.iter().all(|d| d.abs() < 2e-6), "{fast:?} is not {slow:?} at {x},{y}");
            }
        }
    }
}
