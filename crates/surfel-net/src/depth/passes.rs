//! Matching's depth refined in passes: each starts where the one before ended.
//!
//! A pass sees planes that are better than matching's and a confidence that means what it says, so that surfaces
//! reach farther and are chosen more surely; its weights are those of the first. Invariant: what is handed on carries no
//! gradient, so each pass is taught for itself, and every pass sees the same photographs and the same evidence.

use super::likeness::{LIKENESS, Likeness};
use super::patches::patches;
use super::seed_maps::SeedMaps;
use super::{Refined, SceneGeometry, SeededRefinement, disparity};
use crate::config::NetConfig;
use crate::layers::values;
use crate::seed::Seed;
use burn::tensor::{Device, Tensor};
use surfel_core::Grid;

/// What every pass is given.
pub(crate) struct Given<'a> {
    /// Matching's answer, padded to a multiple of the stride.
    pub(super) matched: &'a [Seed],
    /// Offsets of the proposing pixels, beginning with the pixel itself.
    pub(super) offsets: Vec<[i32; 2]>,
    /// Pixels of a block, along each axis.
    pub(super) stride: usize,
    /// How alike the pixel that a block's features stand over is to those that propose to it, per view, block and
    /// proposal.
    pub(super) likenesses: Vec<Vec<[f32; LIKENESS]>>,
    /// Windows of the photographs, see [`patches`].
    pub(super) patches: Tensor<4>,
}

impl<'a> Given<'a> {
    /// Of photographs padded as `matched` is.
    pub(crate) fn new(
        config: &NetConfig,
        photographs: &[Grid<[f32; 3]>],
        matched: &'a [Seed],
        device: &Device,
    ) -> Self {
        let stride = config.refinement.stride;
        let offsets = config.seeded.as_ref().map_or(vec![[0, 0]], |seeded| seeded.offsets());
        let alike = |photograph: &Grid<[f32; 3]>| Likeness::new(photograph).of_blocks(stride, &offsets);
        Self {
            matched,
            likenesses: photographs.iter().map(alike).collect(),
            offsets,
            stride,
            patches: patches(photographs, stride, device),
        }
    }
}

/// The answer of the last pass; `images` `[views, 3, height, width]` are the photographs, `context` their features at
/// stride 4.
pub(crate) fn refined_in_passes(
    refinement: &SeededRefinement,
    config: &NetConfig,
    given: &Given,
    images: Tensor<4>,
    context: Tensor<4>,
    scene: &SceneGeometry,
) -> Refined {
    let device = images.device();
    let seen = refinement.see(config, given, images, context);
    let run = |pass: usize, seeds: &[Seed]| {
        refinement.forward(config, &seen, &SeedMaps::new(seeds, pass, given, scene, &device), scene)
    };
    let mut seeds = given.matched.to_vec();
    let mut refined = run(0, &seeds);
    for pass in 1..config.passes() {
        hand_on(&refined, &mut seeds, scene);
        refined = run(pass, &seeds);
    }
    refined
}

/// Puts the planes of a pass, and its density as their confidence, in the place of those it started from. What the
/// photographs said of matching's planes stays: the next pass compares them anew.
fn hand_on(refined: &Refined, seeds: &mut [Seed], scene: &SceneGeometry) {
    let inverse_depth = disparity(refined.disparity.clone(), scene.ranges);
    let slopes = refined.slopes.iter().cloned();
    let planes = values(Tensor::cat(std::iter::once(inverse_depth).chain(slopes).collect(), 1));
    let density = values(refined.density.clone());
    let pixels = density.len() / seeds.len();
    let of_views = planes.chunks_exact(3 * pixels).zip(density.chunks_exact(pixels));
    for (seed, (planes, density)) in seeds.iter_mut().zip(of_views) {
        let plane = |i: usize| std::array::from_fn(|c| planes[c * pixels + i]);
        seed.planes.as_mut_slice().iter_mut().enumerate().for_each(|(i, own)| *own = plane(i));
        seed.confidence.as_mut_slice().copy_from_slice(density);
    }
}
