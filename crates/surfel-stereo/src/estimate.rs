//! Depth of several views by matching: the order of the steps.
//!
//! sweep -> aggregate -> winners -> left-right check -> fill -> (slanted correction -> plane fit) x rounds
//! -> left-right check -> confidence. Invariant: every threshold is in pixels, shares or candidates, so the
//! result is equivariant to the scale of the scene.

use crate::candidates::Candidates;
use crate::config::MatchConfig;
use crate::consistency::{Agreement, check};
use crate::cost_volume::{CostVolume, MatchImage};
use crate::fill::fill_untrusted;
use crate::plane_fit::{Evidence, Plane, fit_planes};
use crate::semi_global::aggregate;
use crate::slanted::{Correction, correct};
use crate::winner::{Winner, winners};
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
}

/// State of one view between the steps.
struct Surface {
    candidates: Candidates,
    winners: Grid<Winner>,
    planes: Grid<Plane>,
    correction: Grid<Correction>,
}

/// Estimates the depth of every view from its neighbours (indices into `views`).
///
/// A view without neighbours, or a range that is not `0 < near < far`, gives an empty estimate (all zero).
pub fn estimate_depths(views: &[MatchView], neighbours: &[Vec<usize>], config: &MatchConfig) -> Vec<DepthEstimate> {
    let mut surfaces: Vec<Option<Surface>> =
        (0..views.len()).map(|v| sweep_view(views, v, &neighbours[v], config)).collect();
    for round in 0..=config.refinement.rounds {
        let agreement = check_all(views, neighbours, &surfaces);
        surfaces.par_iter_mut().enumerate().for_each(|(v, surface)| {
            if let (Some(surface), Some(agreement)) = (surface.as_mut(), &agreement[v]) {
                refine_view(views, v, &neighbours[v], surface, agreement, round, config);
            }
        });
    }
    let agreement = check_all(views, neighbours, &surfaces);
    (0..views.len())
        .map(|v| match (&surfaces[v], &agreement[v]) {
            (Some(surface), Some(agreement)) => finish(&views[v], surface, agreement, config),
            _ => empty(&views[v]),
        })
        .collect()
}

fn sources_of<'a>(views: &[MatchView<'a>], neighbours: &[usize]) -> Vec<MatchImage<'a>> {
    neighbours.iter().map(|&n| views[n].image).collect()
}

fn sweep_view(views: &[MatchView], v: usize, neighbours: &[usize], config: &MatchConfig) -> Option<Surface> {
    let view = &views[v];
    let range_is_sane = view.near > 0.0 && view.far > view.near && view.far.is_finite();
    if neighbours.is_empty() || !range_is_sane {
        return None;
    }
    let sources = sources_of(views, neighbours);
    let cameras: Vec<Camera> = sources.iter().map(|s| *s.camera).collect();
    let candidates = Candidates::for_pair(view.image.camera, &cameras, view.near, view.far, config.step_px);
    let volume = CostVolume::sweep(&view.image, &sources, candidates, &config.cost);
    let aggregated = aggregate(&volume, view.image.gray, &config.smoothness);
    let winners = winners(volume.width, volume.height, &candidates, &aggregated);
    let planes = winners.map(|winner| Plane { w: winner.inverse_depth, w_x: 0.0, w_y: 0.0 });
    let correction = planes.map(|_| Correction::default());
    Some(Surface { candidates, winners, planes, correction })
}

fn check_all(
    views: &[MatchView],
    neighbours: &[Vec<usize>],
    surfaces: &[Option<Surface>],
) -> Vec<Option<Grid<Agreement>>> {
    let depths: Vec<Option<Grid<f32>>> = surfaces.iter().map(|s| s.as_ref().map(|s| s.planes.map(|p| p.w))).collect();
    (0..views.len())
        .map(|v| {
            let own = depths[v].as_ref()?;
            let others: Vec<(&Camera, &Grid<f32>)> =
                neighbours[v].iter().filter_map(|&n| Some((views[n].image.camera, depths[n].as_ref()?))).collect();
            Some(check(views[v].image.camera, own, &others))
        })
        .collect()
}

/// Round 0 smooths the winners; later rounds correct by the photographs first.
fn refine_view(
    views: &[MatchView],
    v: usize,
    neighbours: &[usize],
    surface: &mut Surface,
    agreement: &Grid<Agreement>,
    round: usize,
    config: &MatchConfig,
) {
    let view = &views[v];
    let trusted = Grid::from_fn(agreement.width(), agreement.height(), |x, y| {
        view.image.valid[(x, y)] && matches!(agreement[(x, y)], Agreement::Within(_))
    });
    let mut planes = fill_untrusted(&surface.planes, &trusted, view.colour);
    let step = surface.candidates.step as f32;
    let evidence = if round == 0 {
        Grid::from_fn(planes.width(), planes.height(), |x, y| Evidence {
            w: planes[(x, y)].w,
            weight: if trusted[(x, y)] { 0.02 + surface.winners[(x, y)].uniqueness } else { 0.0 },
        })
    } else {
        let shift_px = if round == 1 { 0.5 } else { 0.25 };
        let sources = sources_of(views, neighbours);
        surface.correction = correct(&view.image, &sources, &planes, shift_px, &config.refinement);
        Grid::from_fn(planes.width(), planes.height(), |x, y| {
            let Evidence { w, weight } = surface.correction[(x, y)].evidence;
            Evidence { w, weight: if trusted[(x, y)] { weight + 1e-3 } else { 0.0 } }
        })
    };
    let tolerance = step * if round <= 1 { 1.0 } else { 0.5 };
    let passes = if round == 0 { 2 } else { 1 };
    for _ in 0..passes {
        planes = fit_planes(&evidence, &planes, view.colour, tolerance, &config.refinement);
    }
    let (low, high) = (surface.candidates.first as f32, surface.candidates.last() as f32);
    planes.as_mut_slice().iter_mut().for_each(|p| p.w = p.w.clamp(low, high));
    surface.planes = planes;
}

fn finish(view: &MatchView, surface: &Surface, agreement: &Grid<Agreement>, config: &MatchConfig) -> DepthEstimate {
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
    DepthEstimate { depth, normal, confidence, num_candidates: surface.candidates.count }
}

fn empty(view: &MatchView) -> DepthEstimate {
    let (width, height) = (view.image.gray.width(), view.image.gray.height());
    DepthEstimate {
        depth: Grid::filled(width, height, 0.0),
        normal: Grid::filled(width, height, [0.0; 3]),
        confidence: Grid::filled(width, height, 0.0),
        num_candidates: 0,
    }
}
