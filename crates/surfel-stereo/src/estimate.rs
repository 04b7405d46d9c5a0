//! Depth of several views by matching: the order of the steps.
//!
//! At the size of the sweep: sweep -> aggregate -> winners -> rounds of (left-right check -> fill -> slanted
//! correction -> plane fit). At every finer size: upsample -> rounds again. At the end: check -> confidence.
//! Invariant: every threshold is in pixels, shares or candidates, so the
//! result is equivariant to the scale of the scene.

use crate::candidates::Candidates;
use crate::config::MatchConfig;
use crate::consistency::{Agreement, check};
use crate::cost_volume::{CostVolume, MatchImage};
use crate::fill::fill_untrusted;
use crate::plane_fit::{Evidence, Plane, PlaneFit};
use crate::pyramid::{Level, upsampled};
use crate::semi_global::aggregate;
use crate::slanted::{Correction, correct};
use crate::winner::winner;
use rayon::prelude::*;
use surfel_core::normals::normal_from_gradient;
use surfel_core::{Camera, Grid};

/// A view to match and the range of its depths.
#[derive(Clone, Copy, Debug)]
pub struct MatchView<'a> {
    /// The photograph.
    pub image: MatchImage<'a>,
    /// Its colours, guide of the edge-aware steps.
    pub colour: &'a Grid<[f32; 3]>,
    /// Smallest z-depth, scene units.
    pub near: f64,
    /// Largest z-depth, scene units.
    pub far: f64,
}

/// What matching knows of one view.
#[derive(Clone, Debug)]
pub struct DepthEstimate {
    /// z-depth, scene units; 0 where the view has no valid pixel.
    pub depth: Grid<f32>,
    /// Unit surface normals, camera frame, facing the camera; zero where `depth` is.
    pub normal: Grid<[f32; 3]>,
    /// 0 = a guess that continues the surroundings, 1 = seen sharply and confirmed by another view.
    pub confidence: Grid<f32>,
    /// Number of depth candidates of the sweep.
    pub num_candidates: usize,
    /// The surface as a plane per pixel, in inverse depth; also where `depth` is 0.
    pub planes: Grid<Plane>,
    /// What the last photometric correction found, before the last fit smoothed it.
    pub correction: Grid<Correction>,
    /// Inverse depth that moves the middle one of the sources by about a pixel, 1 / scene unit; 0 for an empty estimate.
    pub step: f32,
}

/// State of one view between the steps.
struct Surface {
    candidates: Candidates,
    uniqueness: Grid<f32>,
    planes: Grid<Plane>,
    correction: Grid<Correction>,
}

/// All views at one size, and the inverse-depth step of about one pixel there.
struct Stage<'a> {
    levels: &'a [Level],
    images: Vec<MatchImage<'a>>,
    neighbours: &'a [Vec<usize>],
    config: &'a MatchConfig,
    /// Inverse-depth step per candidate step of the sweep: halves with every upsampling.
    step_share: f32,
}

/// Estimates the depth of every view from its neighbours (indices into `views`).
///
/// A view without neighbours, or a range that is not `0 < near < far`, gives an empty estimate (all zero).
pub fn estimate_depths(views: &[MatchView], neighbours: &[Vec<usize>], config: &MatchConfig) -> Vec<DepthEstimate> {
    let pyramid = pyramid(views, config.max_sweep_pixels);
    let stage = |halvings: usize| Stage::new(&pyramid, halvings, views, neighbours, config);
    let mut surfaces = stage(pyramid.len() - 1).swept(views);
    for halvings in (0..pyramid.len() - 1).rev() {
        for (v, surface) in surfaces.iter_mut().enumerate() {
            if let Some(surface) = surface {
                surface.planes = upsampled(&surface.planes, &pyramid[halvings + 1][v], &pyramid[halvings][v]);
            }
        }
        let finer = stage(halvings);
        for round in 0..config.refinement.finer_rounds {
            finer.refine_all(&mut surfaces, Some(round));
        }
    }
    let agreement = stage(0).check_all(&surfaces);
    (0..views.len())
        .map(|v| match (&surfaces[v], &agreement[v]) {
            (Some(surface), Some(agreement)) => finish(&views[v], surface, agreement, pyramid.len() - 1, config),
            _ => empty(&views[v]),
        })
        .collect()
}

/// Per view, at the size of the sweep only: the inverse depths that another view confirms and that look alike
/// there, and the number of pixels they are from.
pub(crate) fn confident_inverse_depths(
    views: &[MatchView],
    neighbours: &[Vec<usize>],
    config: &MatchConfig,
) -> Vec<(Vec<f32>, usize)> {
    /// Correlation from which two windows look alike beyond chance.
    const ALIKE: f32 = 0.7;
    let pyramid = pyramid(views, config.max_sweep_pixels);
    let stage = Stage::new(&pyramid, pyramid.len() - 1, views, neighbours, config);
    let surfaces = stage.swept(views);
    let agreement = stage.check_all(&surfaces);
    surfaces
        .iter()
        .zip(&agreement)
        .map(|pair| {
            let (Some(surface), Some(agreement)) = pair else { return (Vec::new(), 0) };
            let pixels = surface.planes.as_slice().iter().zip(agreement.as_slice()).zip(surface.correction.as_slice());
            let confident = pixels
                .filter(|((_, a), c)| matches!(a, Agreement::Within(_)) && c.correlation > ALIKE)
                .map(|((plane, _), _)| plane.w)
                .collect();
            (confident, surface.planes.len())
        })
        .collect()
}

/// Levels per number of halvings; the last is small enough to sweep.
fn pyramid(views: &[MatchView], max_pixels: usize) -> Vec<Vec<Level>> {
    let mut pyramid: Vec<Vec<Level>> = vec![views.iter().map(Level::of).collect()];
    while let Some(last) = pyramid.last()
        && last.iter().any(|level| level.colour.len() > max_pixels.max(1024))
    {
        pyramid.push(last.iter().map(Level::halved).collect());
    }
    pyramid
}

impl<'a> Stage<'a> {
    fn new(
        pyramid: &'a [Vec<Level>],
        halvings: usize,
        views: &[MatchView<'a>],
        neighbours: &'a [Vec<usize>],
        config: &'a MatchConfig,
    ) -> Self {
        let levels = &pyramid[halvings];
        let images = levels.iter().zip(views).map(|(level, view)| level.image(view.image.features, halvings)).collect();
        let step_share = 0.5f32.powi((pyramid.len() - 1 - halvings) as i32);
        Self { levels, images, neighbours, config, step_share }
    }

    /// Sweeps every view and refines at this size.
    fn swept(&self, views: &[MatchView]) -> Vec<Option<Surface>> {
        let mut surfaces: Vec<Option<Surface>> =
            views.iter().enumerate().map(|(v, view)| self.sweep_view(v, (view.near, view.far))).collect();
        self.refine_all(&mut surfaces, None);
        for round in 0..self.config.refinement.rounds {
            self.refine_all(&mut surfaces, Some(round));
        }
        surfaces
    }

    fn sources(&self, v: usize) -> Vec<MatchImage<'_>> {
        self.neighbours[v].iter().map(|&n| self.images[n]).collect()
    }

    fn sweep_view(&self, v: usize, (near, far): (f64, f64)) -> Option<Surface> {
        let range_is_sane = near > 0.0 && far > near && far.is_finite();
        if self.neighbours[v].is_empty() || !range_is_sane {
            return None;
        }
        let (image, sources) = (&self.images[v], self.sources(v));
        let cameras: Vec<Camera> = sources.iter().map(|s| *s.camera).collect();
        let candidates = Candidates::for_pair(image.camera, &cameras, near, far, self.config.step_px);
        let volume = CostVolume::sweep(image, &sources, candidates, &self.config.cost);
        let winners = aggregate(&volume, image.gray, &self.config.smoothness, |costs| winner(costs, &candidates));
        let planes = winners.map(|winner| Plane { w: winner.inverse_depth, w_x: 0.0, w_y: 0.0 });
        let correction = planes.map(|_| Correction::default());
        Some(Surface { candidates, uniqueness: winners.map(|winner| winner.uniqueness), planes, correction })
    }

    fn check_all(&self, surfaces: &[Option<Surface>]) -> Vec<Option<Grid<Agreement>>> {
        let depths: Vec<Option<Grid<f32>>> =
            surfaces.iter().map(|s| s.as_ref().map(|s| s.planes.map(|p| p.w))).collect();
        (0..surfaces.len())
            .map(|v| {
                let own = depths[v].as_ref()?;
                let others: Vec<(&Camera, &Grid<f32>)> = self.neighbours[v]
                    .iter()
                    .filter_map(|&n| Some((self.images[n].camera, depths[n].as_ref()?)))
                    .collect();
                Some(check(self.images[v].camera, own, &others))
            })
            .collect()
    }

    /// One round for every view: check, fill, correct by the photographs (unless `round` is `None`: then the
    /// winners of the sweep are only smoothed), fit planes.
    fn refine_all(&self, surfaces: &mut [Option<Surface>], round: Option<usize>) {
        let agreement = self.check_all(surfaces);
        surfaces.par_iter_mut().enumerate().for_each(|(v, surface)| {
            if let (Some(surface), Some(agreement)) = (surface.as_mut(), &agreement[v]) {
                self.refine_view(v, surface, agreement, round);
            }
        });
    }

    fn refine_view(&self, v: usize, surface: &mut Surface, agreement: &Grid<Agreement>, round: Option<usize>) {
        let (image, colour, config) = (&self.images[v], &self.levels[v].colour, &self.config.refinement);
        let trusted = Grid::from_fn(agreement.width(), agreement.height(), |x, y| {
            image.valid[(x, y)] && matches!(agreement[(x, y)], Agreement::Within(_))
        });
        let mut planes = fill_untrusted(&surface.planes, &trusted, colour);
        let step = surface.candidates.step as f32 * self.step_share;
        let evidence = match round {
            None => Grid::from_fn(planes.width(), planes.height(), |x, y| Evidence {
                w: planes[(x, y)].w,
                weight: if trusted[(x, y)] { 0.02 + surface.uniqueness[(x, y)] } else { 0.0 },
            }),
            Some(round) => {
                let shift_px = if round == 0 { 0.5 } else { 0.25 };
                surface.correction = correct(image, &self.sources(v), &planes, shift_px, config);
                Grid::from_fn(planes.width(), planes.height(), |x, y| {
                    let Evidence { w, weight } = surface.correction[(x, y)].evidence;
                    Evidence { w, weight: if trusted[(x, y)] { weight + 1e-3 } else { 0.0 } }
                })
            }
        };
        let fit = |tolerance: f32| PlaneFit::new(&evidence, colour, tolerance, config);
        planes = match round {
            None => {
                let fit = fit(step);
                fit.planes(&fit.planes(&planes))
            }
            Some(0) => fit(step).curved(&planes),
            Some(_) => fit(0.5 * step).curved(&planes),
        };
        let (low, high) = (surface.candidates.first as f32, surface.candidates.last() as f32);
        planes.as_mut_slice().iter_mut().for_each(|p| p.w = p.w.clamp(low, high));
        surface.planes = planes;
    }
}

fn finish(
    view: &MatchView,
    surface: &Surface,
    agreement: &Grid<Agreement>,
    halvings: usize,
    config: &MatchConfig,
) -> DepthEstimate {
    let (width, height) = (surface.planes.width(), surface.planes.height());
    let valid = view.image.valid;
    let depth = Grid::from_fn(width, height, |x, y| if valid[(x, y)] { 1.0 / surface.planes[(x, y)].w } else { 0.0 });
    let normal = Grid::from_fn(width, height, |x, y| {
        if !valid[(x, y)] {
            return [0.0; 3];
        }
        let plane = surface.planes[(x, y)];
        // z = 1/w, hence dz = -dw / w².
        let z = 1.0 / f64::from(plane.w);
        let (z_x, z_y) = (-f64::from(plane.w_x) * z * z, -f64::from(plane.w_y) * z * z);
        normal_from_gradient(&view.image.camera.intrinsics, x as f64, y as f64, z, z_x, z_y)
    });
    let confidence = Grid::from_fn(width, height, |x, y| {
        let agreed = match agreement[(x, y)] {
            Agreement::Within(px) => (-(px / config.consistency_px).powi(2)).exp(),
            Agreement::Contradicted(_) | Agreement::Unseen => 0.0,
        };
        let matched = surface.correction[(x, y)].correlation.clamp(0.0, 1.0);
        if valid[(x, y)] { agreed * matched.sqrt() } else { 0.0 }
    });
    let step = surface.candidates.step / config.step_px * 0.5f64.powi(halvings as i32);
    DepthEstimate {
        depth,
        normal,
        confidence,
        num_candidates: surface.candidates.count,
        planes: surface.planes.clone(),
        correction: surface.correction.clone(),
        step: step as f32,
    }
}

fn empty(view: &MatchView) -> DepthEstimate {
    let (width, height) = (view.image.gray.width(), view.image.gray.height());
    DepthEstimate {
        depth: Grid::filled(width, height, 0.0),
        normal: Grid::filled(width, height, [0.0; 3]),
        confidence: Grid::filled(width, height, 0.0),
        num_candidates: 0,
        planes: Grid::filled(width, height, Plane::default()),
        correction: Grid::filled(width, height, Correction::default()),
        step: 0.0,
    }
}
