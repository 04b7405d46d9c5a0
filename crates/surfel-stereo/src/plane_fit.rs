//! A local plane through noisy inverse depths: moving least squares, edge-aware.
//!
//! A plane in space is affine in inverse depth, `w(x, y) = a + b x + c y`, so fitting one is a 3x3 linear
//! system per pixel and bends with no perspective. Invariant: an exact plane is reproduced exactly.

use crate::config::Refinement;
pub(crate) use crate::normal_equations::solve_symmetric;
use crate::normal_equations::{FitRow, Layers, Reach, Row, Run, STRENGTH_RADIUS, STRONG, runs};
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

/// A fitted plane with what a second fit took from it.
pub(crate) fn given_back(fitted: Plane, flattened: Plane, strength: f32) -> Plane {
    let share = (strength / STRONG).min(1.0);
    Plane {
        w: fitted.w + share * (fitted.w - flattened.w),
        w_x: fitted.w_x + share * (fitted.w_x - flattened.w_x),
        w_y: fitted.w_y + share * (fitted.w_y - flattened.w_y),
    }
}

/// Fits planes to evidence.
pub struct PlaneFit {
    layers: Layers,
    runs: Vec<Run>,
    reach: Reach,
    inverse_tolerance_sq: f32,
    inverse_edge_sq: f32,
}

impl PlaneFit {
    /// Neighbours that disagree with what is believed of a surface by more than about `tolerance` (inverse depth)
    /// belong to another one and lose their weight, as do those whose colour in `guide` differs.
    pub fn new(evidence: &Grid<Evidence>, guide: &Grid<[f32; 3]>, tolerance: f32, config: &Refinement) -> Self {
        let offsets = neighbourhood(config);
        let farthest = offsets.iter().map(|&(dx, dy)| dx.abs().max(dy.abs())).max().unwrap_or(0);
        let layers = Layers::new(evidence, guide, STRENGTH_RADIUS.max(farthest as usize));
        Self {
            runs: runs(&offsets, &layers.layout),
            layers,
            reach: reach(config),
            inverse_tolerance_sq: 1.0 / (tolerance * tolerance),
            inverse_edge_sq: 1.0 / (config.fit_edge * config.fit_edge),
        }
    }

    /// A plane around every pixel of a surface that is believed to be `current`.
    pub fn planes(&self, current: &Grid<Plane>) -> Grid<Plane> {
        let arch = Arch::new();
        let mut planes = current.clone();
        planes.as_mut_slice().par_chunks_mut(current.width()).enumerate().for_each_init(
            Row::default,
            |row, (y, planes)| {
                arch.dispatch(FitRow {
                    layers: &self.layers,
                    runs: &self.runs,
                    y,
                    reach: self.reach,
                    inverse_tolerance_sq: self.inverse_tolerance_sq,
                    inverse_edge_sq: self.inverse_edge_sq,
                    row,
                    planes,
                });
            },
        );
        planes
    }

    /// The same, less what the fit flattens.
    ///
    /// A plane through a curved surface lies behind every bump and before every dent. How far, the fit of the fitted
    /// surface tells: what it flattens again is given back (J. W. Tukey's twicing), in full where evidence is strong
    /// and the less the weaker it is, for noise is given back as well.
    pub fn curved(mut self, current: &Grid<Plane>) -> Grid<Plane> {
        let mut planes = self.planes(current);
        self.layers.say(&planes);
        let flattened = self.planes(current);
        let each = planes.as_mut_slice().iter_mut().zip(flattened.as_slice()).zip(self.layers.strength.as_slice());
        each.for_each(|((plane, flattened), strength)| *plane = given_back(*plane, *flattened, *strength));
        planes
    }
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
            planes = PlaneFit::new(&evidence, &guide, 0.02, &Refinement::default()).planes(&planes);
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
    fn a_curved_surface_keeps_its_height() {
        // A bump: a plane through its surroundings lies behind it.
        let truth = |x: usize, y: usize| 0.5 - 1e-4 * ((x as f32 - 20.0).powi(2) + (y as f32 - 16.0).powi(2));
        let evidence = |weight: f32| Grid::from_fn(41, 33, |x, y| Evidence { w: truth(x, y), weight });
        let current = Grid::from_fn(41, 33, |x, y| Plane { w: truth(x, y), w_x: 0.0, w_y: 0.0 });
        let guide = Grid::filled(41, 33, [0.5; 3]);
        let config = Refinement::default();
        let fit = |weight: f32| PlaneFit::new(&evidence(weight), &guide, 0.05, &config);
        let error = |planes: Grid<Plane>| (planes[(20, 16)].w - truth(20, 16)).abs();
        let (flat, curved) = (error(fit(1.0).planes(&current)), error(fit(1.0).curved(&current)));
        assert!(curved < 0.5 * flat, "{curved} instead of {flat}");
        // Where evidence is weak nothing is given back, lest it be noise.
        let (flat, curved) = (error(fit(1e-4).planes(&current)), error(fit(1e-4).curved(&current)));
        assert!((curved - flat).abs() < 0.01 * flat);
    }

    #[test]
    fn two_surfaces_stay_apart() {
        let truth = |x: usize| if x < 10 { 0.5 } else { 0.9 };
        let evidence = Grid::from_fn(20, 16, |x, _| Evidence { w: truth(x), weight: 1.0 });
        let current = Grid::from_fn(20, 16, |x, _| Plane { w: truth(x), w_x: 0.0, w_y: 0.0 });
        let guide = Grid::filled(20, 16, [0.5; 3]);
        let planes = PlaneFit::new(&evidence, &guide, 0.01, &Refinement::default()).planes(&current);
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
        let slow = |evidence: &Grid<Evidence>| {
            let fit = |x, y| twin::fit_plane(evidence, current[(x, y)], &guide, 0.01, &config, (x, y));
            Grid::from_fn(width, height, fit)
        };
        let once = slow(&evidence);
        let again = slow(&Grid::from_fn(width, height, |x, y| Evidence { w: once[(x, y)].w, ..evidence[(x, y)] }));
        let twice = Grid::from_fn(width, height, |x, y| {
            given_back(once[(x, y)], again[(x, y)], twin::strength(&evidence, (x, y)))
        });
        let fit = || PlaneFit::new(&evidence, &guide, 0.01, &config);
        for (fast, slow) in [(fit().planes(&current), once), (fit().curved(&current), twice)] {
            for (i, (fast, slow)) in fast.as_slice().iter().zip(slow.as_slice()).enumerate() {
                let apart = [fast.w - slow.w, fast.w_x - slow.w_x, fast.w_y - slow.w_y];
                assert!(apart.iter().all(|d| d.abs() < 2e-6), "{fast:?} is not {slow:?} at {i}");
            }
        }
    }
}
