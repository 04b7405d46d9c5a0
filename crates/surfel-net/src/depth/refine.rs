//! Coarse depth to full resolution (spec 2.4.4 to 2.4.6), optionally with a second, narrow plane sweep.
//!
//! Works at a stride of 1 (the paper), 2 or 4 and unfolds the rest into pixels at the end. Also collects the
//! feature `F` each surfel is decoded from. Invariant: relative disparity stays in \[0, 1\].

use super::choice::Choice;
use super::disparity;
use super::features::Features;
use crate::config::{NetConfig, RefinementConfig};
use crate::cost_volume::{DepthRange, sweep, warps};
use crate::layers::{Conv2d, conv3x3, depth_to_space, group_norm, space_to_depth, upsample, values};
use crate::ops::plane_sweep;
use crate::ops::plane_sweep::Base;
use crate::ops::{Activation, gelu, group_norm as normed};
use crate::unet::Unet;
use burn::module::Module;
use burn::nn::GroupNorm;
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Int, Tensor};
use std::sync::Arc;
use surfel_core::Camera;

/// Depth and features at full resolution.
pub(crate) struct Refined {
    /// Relative disparity, `[views, 1, height, width]`.
    pub(crate) disparity: Tensor<4>,
    /// Opacity before mapping, in (0, 1), `[views, 1, height, width]`.
    pub(crate) density: Tensor<4>,
    /// The paper's `F`.
    pub(crate) features: Features,
    /// Change of disparity (1 / scene unit) per pixel to the right and down, `[views, 2, height, width]`;
    /// known to a seeded network.
    pub(crate) slopes: Option<Tensor<4>>,
    /// How the planes were chosen; only in a seeded network.
    pub(crate) choice: Option<Choice>,
}

/// What the refinement needs to know of the scene.
pub(crate) struct SceneGeometry<'a> {
    pub(crate) cameras: &'a [Camera],
    pub(crate) neighbours: &'a [Vec<usize>],
    pub(crate) ranges: &'a [DepthRange],
    /// For each view, itself and its neighbours.
    pub(crate) sources: &'a Tensor<2, Int>,
}

/// The refinement.
#[derive(Module, Debug)]
pub(crate) struct Refinement {
    upsampler: Conv2d,
    project: Conv2d,
    matcher: Option<Conv2d>,
    enter: Conv2d,
    enter_norm: GroupNorm,
    unet: Unet,
    to_disparity: [Conv2d; 2],
}

impl Refinement {
    pub(crate) fn new(config: &NetConfig, device: &Device) -> Self {
        let RefinementConfig { stride, upsampled_channels, unet, sweep } = &config.refinement;
        let (width, image) = (unet.channels, 3 * stride * stride);
        let num_fine = sweep.as_ref().map_or(0, |s| s.num_candidates);
        Self {
            upsampler: conv3x3(2 * config.backbone.channels(), *upsampled_channels, device),
            project: conv3x3(*upsampled_channels, width, device),
            matcher: sweep.as_ref().map(|s| conv3x3(upsampled_channels + image, s.channels, device)),
            enter: conv3x3(image + width + 2 + num_fine, width, device),
            enter_norm: group_norm(width, 4, device),
            unet: Unet::new(unet, device),
            to_disparity: [conv3x3(width, 2 * width, device), conv3x3(2 * width, 2 * stride * stride, device)],
        }
    }

    /// `images` at full resolution, `matching` and `context` features at stride 4, `coarse` relative
    /// disparity and confidence at stride 4.
    pub(crate) fn forward(
        &self,
        config: &NetConfig,
        images: Tensor<4>,
        (matching, context): (Tensor<4>, Tensor<4>),
        (coarse, confidence): (Tensor<4>, Tensor<4>),
        scene: &SceneGeometry,
    ) -> Refined {
        let stride = config.refinement.stride;
        let factor = 4 / stride;
        let upsampled = self.upsampler.forward(Tensor::cat(vec![matching, context], 1));
        let upsampled = gelu(upsample(upsampled, factor, 0));
        let pixels = space_to_depth(images.clone(), stride);
        let at_stride = upsample(coarse.clone(), factor, 0);
        let confidence = upsample(confidence, factor, 0);
        let projected = self.project.forward(upsampled.clone());
        let mut inputs = vec![pixels.clone(), projected, at_stride.clone(), confidence];
        if let Some(matcher) = &self.matcher {
            let features = matcher.forward(Tensor::cat(vec![upsampled.clone(), pixels], 1));
            inputs.push(fine_correlation(config, features, at_stride, scene));
        }
        let x = normed(&self.enter_norm, self.enter.forward(Tensor::cat(inputs, 1)), Activation::Gelu, None);
        let refined = self.unet.forward(x, scene.sources);
        let [first, second] = &self.to_disparity;
        let output = depth_to_space(second.forward(gelu(first.forward(refined.clone()))), stride);
        let correction = output.clone().narrow(1, 0, 1);
        Refined {
            disparity: (upsample(coarse, 4, 0) + correction).clamp(0.0, 1.0),
            density: sigmoid(output.narrow(1, 1, 1)),
            features: Features { refined, images, upsampled, stride },
            slopes: None,
            choice: None,
        }
    }
}

/// Correlations of candidates around the coarse disparity; no gradient flows into their position.
fn fine_correlation(config: &NetConfig, features: Tensor<4>, coarse: Tensor<4>, scene: &SceneGeometry) -> Tensor<4> {
    let Some(fine) = &config.refinement.sweep else { return features };
    let [_, _, height, width] = features.dims();
    let half = (fine.num_candidates / 2) as f64;
    let coarse_steps = config.cost_volume.as_ref().map_or(1.0, |volume| (volume.num_candidates - 1) as f64);
    let disparities = scene.ranges.iter().map(|range| {
        let step = fine.step * range.disparity_span() / coarse_steps;
        (0..fine.num_candidates).map(|j| ((j as f64 - half) * step) as f32).collect()
    });
    let base = Base::PerPixel(values(disparity(coarse.detach(), scene.ranges)));
    let warps = warps(scene.cameras, scene.neighbours, config.refinement.stride);
    plane_sweep(features, Arc::new(sweep(warps, (width, height), disparities.collect(), base)))
}
