//! The learned half of the depth step: what matching found, refined by the network, and its surfels.
//!
//! Between matching and rendering (`--depth network`). Invariant: estimates and views correspond one to one, and a
//! pixel outside the photograph's mask has neither depth nor surfel.

use super::error::ReconstructError;
use surfel_core::normals::normal_from_rotation;
use surfel_core::{Camera, Grid, Surfels, View};
use surfel_net::{DepthRange, SceneInput, Seed, SurfelNet, values};
use surfel_stereo::DepthEstimate;

/// Depth, normals and confidence by the network, and the surfels it predicts; working frame.
pub struct Learned {
    /// Per view; planes and candidates remain those of matching.
    pub estimates: Vec<DepthEstimate>,
    /// View-major, one per pixel that has depth.
    pub surfels: Surfels,
    /// Their scales before the second pass of the head.
    pub first_scales: FirstScales,
}

/// Scales `[s_u, s_v]` of the same surfels in the same order, before and after the adaptation to the sampling rate.
#[derive(Clone, Debug, Default)]
pub struct FirstScales {
    /// As first placed.
    pub initial: Vec<[f32; 2]>,
    /// After the low-pass filter; the initial ones where a network has no adaptation.
    pub adapted: Vec<[f32; 2]>,
}

/// Runs the network on views and what matching says of them; `ranges` are near and far per view.
///
/// # Errors
/// [`ReconstructError::Network`] when the network cannot work with the views.
pub fn refine(
    net: &SurfelNet,
    views: &[View],
    estimates: &[DepthEstimate],
    ranges: &[(f64, f64)],
) -> Result<Learned, ReconstructError> {
    let device = net.device();
    let images: Vec<Grid<[f32; 3]>> = views.iter().map(|view| view.image.clone()).collect();
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let ranges: Vec<DepthRange> = ranges.iter().map(|&(near, far)| DepthRange { near, far }).collect();
    let seeds: Vec<Seed> =
        if net.config().seeded.is_some() { estimates.iter().map(Seed::from).collect() } else { Vec::new() };
    let scene = SceneInput { images: &images, cameras: &cameras, ranges: &ranges, seeds: &seeds };
    let prediction = net.forward(&scene, &device)?;
    let (depth, confidence) = (values(prediction.maps.depth), values(prediction.maps.confidence));
    let surfels = prediction.surfels.to_surfels();
    let initial = prediction.initial.to_surfels().scales;
    let adapted: Vec<[f32; 2]> = match &prediction.adaptation {
        Some(adaptation) => adaptation.scales.iter().map(|scales| scales.map(|s| s as f32)).collect(),
        None => initial.clone(),
    };
    let mut first_scales = FirstScales::default();
    let pixels = views[0].image.len();
    let mut kept = Surfels { sh_degree: surfels.sh_degree, ..Surfels::default() };
    let mut learned = Vec::with_capacity(views.len());
    let num_sh = surfels.sh.len() / surfels.len().max(1);
    for (v, (view, estimate)) in views.iter().zip(estimates).enumerate() {
        let (width, height) = (view.image.width(), view.image.height());
        let at = |x: usize, y: usize| v * pixels + y * width + x;
        let seen = |x: usize, y: usize| view.valid[(x, y)];
        for k in (0..pixels).filter(|i| seen(i % width, i / width)).map(|i| v * pixels + i) {
            kept.centres.push(surfels.centres[k]);
            kept.scales.push(surfels.scales[k]);
            first_scales.initial.push(initial[k]);
            first_scales.adapted.push(adapted[k]);
            kept.rotations.push(surfels.rotations[k]);
            kept.opacities.push(surfels.opacities[k]);
            kept.sh.extend_from_slice(&surfels.sh[k * num_sh..][..num_sh]);
        }
        learned.push(DepthEstimate {
            depth: Grid::from_fn(width, height, |x, y| if seen(x, y) { depth[at(x, y)] } else { 0.0 }),
            normal: Grid::from_fn(width, height, |x, y| {
                if seen(x, y) {
                    normal_from_rotation(&view.camera, x, y, surfels.rotations[at(x, y)])
                } else {
                    [0.0; 3]
                }
            }),
            confidence: Grid::from_fn(width, height, |x, y| if seen(x, y) { confidence[at(x, y)] } else { 0.0 }),
            ..estimate.clone()
        });
    }
    Ok(Learned { estimates: learned, surfels: kept, first_scales })
}
