//! Matching's depth to a better one: the refinement of a network whose coarse depth is a [`Seed`].
//!
//! At half resolution (or another stride) a U-Net sees the photograph, pretrained features, what matching knows,
//! and how well the photographs and learned features agree at the planes its surroundings propose; it weighs these
//! planes (`ops::propagate`) and adds a correction; `passes` runs it. Invariant: a fresh network returns matching's depth
//! but for the softness of the weights, and everything is in steps, so neither unit nor depth range is seen.

use super::choice::Choice;
use super::features::Features;
use super::passes::Given;
use super::scorer::Scorer;
use super::seed_maps::{KNOWN, SeedMaps};
use super::{Refined, SceneGeometry, per_view};
use crate::config::{FineSweepConfig, NetConfig, RefinementConfig, SeededConfig};
use crate::cost_volume::{sweep, warps};
use crate::layers::{Conv2d, conv3x3, depth_to_space, group_norm, space_to_depth, upsample};
use crate::ops::plane_sweep::Base;
use crate::ops::{Activation, gelu, group_norm as normed, plane_sweep, propagate_planes};
use crate::unet::Unet;
use burn::module::{Module, Param};
use burn::nn::GroupNorm;
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Tensor, TensorData};
use std::sync::Arc;
use surfel_core::Camera;

/// Correlations known of a proposal: of learned features and of the photographs.
const MATCHED: usize = 2;
/// Score by which a pixel's own plane leads at the start.
const OWN_LEAD: f64 = 7.0;
/// Corrections of a plane, a density and a lean per pixel.
const PER_PIXEL: usize = 5;
/// Lean of an output of one, as much as a score of one (`scorer.rs`).
const LEAN: f64 = 10.0;
/// Offset, in steps, up to which what a pass starts from knows better where it is sure.
const FINE_STEPS: f64 = 1.5;
/// The same of matching, for all that several passes moved: noise makes matching sure of more than it should be.
const FINEST_STEPS: f64 = 0.5;
/// Steps, and tangents of tilt, that an output of one corrects: an optimiser's step must not overthrow a surface.
const CORRECTION: f64 = 0.1;

/// What the photographs show whatever their depth, at `1 / stride` but for the images themselves.
pub(super) struct Seen {
    images: Tensor<4>,
    pixels: Tensor<4>,
    upsampled: Tensor<4>,
    /// What is compared between views.
    features: Option<Tensor<4>>,
    /// Windows of the photographs, compared as they are.
    patches: Tensor<4>,
}

/// The refinement.
#[derive(Module, Debug)]
pub(crate) struct SeededRefinement {
    upsampler: Conv2d,
    matcher: Option<Conv2d>,
    enter: Conv2d,
    enter_norm: GroupNorm,
    unet: Unet,
    to_planes: [Conv2d; 2],
    scorer: Scorer,
}

impl SeededRefinement {
    pub(crate) fn new(config: &NetConfig, seeded: &SeededConfig, device: &Device) -> Self {
        let RefinementConfig { stride, upsampled_channels, unet, sweep } = &config.refinement;
        let (width, image) = (unet.channels, 3 * stride * stride);
        let num_proposals = seeded.num_proposals();
        // Tries are matched twice: by the photographs and by learned features.
        let num_tries = |sweep: &FineSweepConfig| 2 * (sweep.num_candidates + num_proposals - 1);
        let matched = sweep.as_ref().map_or(0, num_tries);
        let inputs = image + upsampled_channels + SeedMaps::channels(*stride, num_proposals) + matched;
        let mut last = conv3x3(2 * width, PER_PIXEL * stride * stride, device);
        last.weight = Param::from_tensor(last.weight.val().zeros_like());
        last.bias = last.bias.map(|bias| Param::from_tensor(bias.val().zeros_like()));
        Self {
            upsampler: conv3x3(config.backbone.channels(), *upsampled_channels, device),
            matcher: sweep.as_ref().map(|s| conv3x3(upsampled_channels + image, s.channels, device)),
            enter: conv3x3(inputs, width, device),
            enter_norm: group_norm(width, 4, device),
            unet: Unet::new(unet, device),
            to_planes: [conv3x3(width, 2 * width, device), last],
            scorer: Scorer::new(KNOWN + if sweep.is_some() { MATCHED } else { 0 }, 2 * width, device),
        }
    }

    /// What the photographs show whatever their depth: `images` `[views, 3, height, width]`, `context` features at
    /// stride 4.
    pub(super) fn see(&self, config: &NetConfig, given: &Given, images: Tensor<4>, context: Tensor<4>) -> Seen {
        let stride = config.refinement.stride;
        let upsampled = gelu(upsample(self.upsampler.forward(context), 4 / stride, 0));
        let pixels = space_to_depth(images.clone(), stride);
        let both = || Tensor::cat(vec![upsampled.clone(), pixels.clone()], 1);
        let features = self.matcher.as_ref().map(|matcher| matcher.forward(both()));
        Seen { images, pixels, upsampled, features, patches: given.patches.clone() }
    }

    /// One pass.
    pub(super) fn forward(&self, config: &NetConfig, seen: &Seen, seeds: &SeedMaps, scene: &SceneGeometry) -> Refined {
        let stride = config.refinement.stride;
        let Seen { images, pixels, upsampled, features, patches } = seen;
        let mut inputs = vec![pixels.clone(), upsampled.clone(), seeds.inputs.clone()];
        let mut known = seeds.known.clone();
        if let Some(features) = features {
            let matched = agreement(config, [features, patches], seeds, scene);
            let of_proposals = matched.iter().map(|tries| at_proposals(tries, seeds.proposals.offsets.len()));
            known = Tensor::cat(std::iter::once(known).chain(of_proposals).collect(), 2);
            inputs.extend(matched);
        }
        let x = normed(&self.enter_norm, self.enter.forward(Tensor::cat(inputs, 1)), Activation::Gelu, None);
        let refined = self.unet.forward(x, scene.sources);
        let [first, second] = &self.to_planes;
        let context = gelu(first.forward(refined.clone()));
        let per_pixel = depth_to_space(second.forward(context.clone()), stride);
        let moves = config.seeded.as_ref().is_some_and(|seeded| seeded.moves_depth);
        let scores = self.scorer.forward(known, context);
        let scores = if moves { scores } else { scores.zeros_like() };
        let scores = scores + own_lead(seeds.proposals.offsets.len(), &per_pixel.device());
        let leans = per_pixel.clone().narrow(1, 4, 1) * LEAN;
        let leans = if moves { leans } else { leans.zeros_like() };
        let choice = Choice::new(scores.clone(), leans.clone(), seeds);
        let planes = propagate_planes(scores, leans, seeds.proposals.clone());
        let offset = planes.clone().narrow(1, 0, 1) + per_pixel.clone().narrow(1, 0, 1) * CORRECTION;
        let density = sigmoid(per_pixel.clone().narrow(1, 3, 1) + (seeds.confidence.clone() * 4.0 - 2.0));
        let offset = if moves { offset } else { offset.zeros_like() };
        let moved = moved(offset, density.clone().detach(), seeds);
        let device = planes.device();
        // Steps of the view, from the far end, over the range: relative disparity.
        let far = per_view(scene.ranges, |range| range.far_disparity(), &device);
        let span = per_view(scene.ranges, |range| range.disparity_span(), &device);
        let disparity = ((moved - far) / span).clamp(0.0, 1.0);
        // A tilt is a change of inverse depth per pixel over inverse depth, times the focal length.
        let tilt = per_pixel.narrow(1, 1, 2) * inverse_focal(scene.cameras, &device) * CORRECTION;
        let slopes = planes.narrow(1, 1, 2) * seeds.steps.clone() + tilt * seeds.inverse_depth.clone();
        let features = Features { refined, images: images.clone(), upsampled: upsampled.clone(), stride };
        Refined { disparity, density, features, slopes: Some(slopes), choice: Some(choice) }
    }
}

/// Inverse depth, 1 / scene unit, `offset` steps from where the pass starts but for what is drawn back. Noise makes
/// matching sure of what is wrong; the density has learned better, but not to hold.
fn moved(offset: Tensor<4>, density: Tensor<4>, seeds: &SeedMaps) -> Tensor<4> {
    let steps = || seeds.steps.clone();
    let offset = held(offset, FINE_STEPS, seeds.confidence.clone() * density.clone());
    let moved = offset * steps() + seeds.inverse_depth.clone();
    let Some([sure, matched]) = seeds.matched.clone() else { return moved };
    // What earlier passes moved counts as well: many small steps are no less noise than one.
    held((moved - matched.clone()) / steps(), FINEST_STEPS, sure * density) * steps() + matched
}

/// Offsets in steps, drawn back to nothing where what they start from is surely right and they are small, about `fine`:
/// a plane fitted to the photographs is finer than what a network learns, but a large mistake is not.
fn held(offset: Tensor<4>, fine: f64, sureness: Tensor<4>) -> Tensor<4> {
    let is_small = (offset.clone() / fine).powi_scalar(2).neg().exp();
    offset * (-(is_small * sureness) + 1.0)
}

/// `1 / fx, 1 / fy` per view, `[views, 2, 1, 1]`, 1 / pixel.
fn inverse_focal(cameras: &[Camera], device: &Device) -> Tensor<4> {
    let focal = cameras.iter().flat_map(|camera| [camera.intrinsics.fx, camera.intrinsics.fy]);
    let inverse: Vec<f32> = focal.map(|focal| (1.0 / focal) as f32).collect();
    Tensor::from_data(TensorData::new(inverse, [cameras.len(), 2, 1, 1]), device)
}

/// The head start of each pixel's own plane, the first proposal.
fn own_lead(count: usize, device: &Device) -> Tensor<4> {
    let mut lead = vec![0.0f32; count];
    lead[0] = OWN_LEAD as f32;
    Tensor::<1>::from_floats(lead.as_slice(), device).reshape([1, count, 1, 1])
}

/// Correlations at every try of what is seen, learned features and windows of the photographs; no gradient flows into the tries.
fn agreement(config: &NetConfig, seen: [&Tensor<4>; 2], seeds: &SeedMaps, scene: &SceneGeometry) -> Vec<Tensor<4>> {
    let Some(fine) = &config.refinement.sweep else { return Vec::new() };
    let [views, _, height, width] = seen[0].dims();
    let half = (fine.num_candidates / 2) as f64;
    let offsets: Vec<f32> = (0..fine.num_candidates).map(|j| ((j as f64 - half) * fine.step) as f32).collect();
    let tries = seeds.tries(&offsets);
    let count = tries.len() / (views * height * width);
    let warps = warps(scene.cameras, scene.neighbours, config.refinement.stride);
    let geometry = sweep(warps, (width, height), vec![vec![0.0; count]; views], Base::PerCandidate(tries));
    let geometry = Arc::new(geometry);
    seen.map(|maps| plane_sweep(maps.clone(), geometry.clone())).into()
}

/// The tries that are proposals, the pixel's own plane first, `[views, proposals, 1, h, w]`.
fn at_proposals(tries: &Tensor<4>, num_proposals: usize) -> Tensor<5> {
    let [_, count, _, _] = tries.dims();
    let num_fine = count + 1 - num_proposals;
    let own = tries.clone().narrow(1, num_fine / 2, 1);
    let others = tries.clone().narrow(1, num_fine, num_proposals - 1);
    Tensor::cat(vec![own, others], 1).unsqueeze_dim(2)
}
