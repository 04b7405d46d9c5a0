//! What the network is taught: planes, orientations and honesty, from exact truth (spec 4.3).
//!
//! Depth errors are counted in steps (about a pixel of parallax), so every term is free of units. Invariants: pixels
//! whose truth is not known say nothing, and a term of which nothing is known is left out; the truth itself has loss
//! zero but for the opacity term, whose least value is reached by the true probability of being right.

use crate::choice::divergence;
use crate::error::TrainError;
use crate::facing::facing;
use crate::rendered::{self, RenderedWeights};
use crate::sample::Sample;
use crate::slope::slope;
use crate::truth_tensors::TruthTensors;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};
use surfel_loss::Perceptual;
use surfel_net::{EncoderMaps, Prediction, SurfelTensors};

/// Weights of the terms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossWeights {
    /// `L_d`: depth.
    pub depth: f64,
    /// `L_n`: orientation of the final surfels.
    pub normal: f64,
    /// The same of the initial surfels.
    pub initial_normal: f64,
    /// The same of the planes under the surfels, before the head's say.
    #[serde(default)]
    pub plane_normal: f64,
    /// How the depth map runs from pixel to pixel.
    #[serde(default)]
    pub slope: f64,
    /// Belief in the planes that are proposed to each block.
    #[serde(default)]
    pub choice: f64,
    /// Opacity as the probability that the depth is right.
    pub opacity: f64,
    /// How much more a pixel of an object counts in depth and choice than one of its surroundings.
    #[serde(default = "one")]
    pub object_factor: f64,
    /// Terms on maps rendered from the final surfels.
    #[serde(default)]
    pub rendered: RenderedWeights,
}

fn one() -> f64 {
    1.0
}

impl LossWeights {
    /// The weights at a step of the run.
    pub fn at(&self, step: u64) -> Self {
        Self { rendered: self.rendered.at(step), ..*self }
    }

    /// Whether a term looks at the surfels, or only at the encoder's maps.
    pub fn needs_surfels(&self) -> bool {
        self.normal != 0.0 || self.initial_normal != 0.0 || self.rendered.is_some()
    }
}

/// What a network says of a sample, as far as the loss asks for it.
#[derive(Clone, Copy)]
pub struct Said<'a> {
    /// The encoder's maps.
    pub maps: &'a EncoderMaps,
    /// Initial and final surfels.
    pub surfels: Option<[&'a SurfelTensors; 2]>,
}

impl<'a> From<&'a Prediction> for Said<'a> {
    fn from(prediction: &'a Prediction) -> Self {
        Self { maps: &prediction.maps, surfels: Some([&prediction.initial, &prediction.surfels]) }
    }
}

/// The terms of one sample: name, weight and unweighted scalar of each that has a weight.
pub struct Terms(Vec<(&'static str, f64, Tensor<1>)>);

impl Terms {
    /// The weighted sum; `None` when no term has a weight.
    pub fn total(&self) -> Option<Tensor<1>> {
        self.0.iter().map(|(_, weight, term)| term.clone() * *weight).reduce(|sum, term| sum + term)
    }

    /// Name and value of each.
    pub fn named(&self) -> Vec<(&'static str, f64)> {
        self.0.iter().map(|(name, _, term)| (*name, f64::from(term.clone().into_scalar::<f32>()))).collect()
    }
}

/// Error, in steps, below which the depth loss is nearly linear and above which it grows ever slower.
const KNEE_STEPS: f64 = 0.25;
/// Share of the plain absolute error, which keeps large mistakes worth mending.
const LINEAR: f64 = 0.1;
/// Largest error that counts, steps.
const LARGEST_STEPS: f64 = 16.0;
/// Relative depth error up to which a pixel counts as right.
const RIGHT: f64 = 0.01;

/// The terms of what is `said` of `sample` that have a weight and of whose truth something is known.
///
/// # Errors
/// When the surfels cannot be rendered for the terms that ask for it.
pub fn terms(
    said: Said,
    sample: &Sample,
    weights: &LossWeights,
    perceptual: &Perceptual,
    device: &Device,
) -> Result<Terms, TrainError> {
    let truth = TruthTensors::of(sample, weights.object_factor, device);
    let knows_depth = sample.truth.iter().any(|view| view.depth.is_some());
    let knows_normals = sample.truth.iter().any(|view| view.normal.is_some());
    let TruthTensors { inverse_depth, has_depth, knows_surface, inverse_step, normals, has_normal, counts } = truth;
    let predicted = said.maps.depth.clone().recip();
    let depth = || {
        let error = ((predicted.clone() - inverse_depth.clone()) * inverse_step.clone()).abs();
        let error = error.clamp_max(LARGEST_STEPS);
        let robust = (error.clone() / KNEE_STEPS).log1p() * KNEE_STEPS + error * LINEAR;
        mean(robust.flatten(0, 2), (has_depth.clone() * counts.clone()).flatten(0, 2))
    };
    let opacity = || {
        let relative = (inverse_depth.clone() / predicted.clone().detach() - 1.0).abs();
        let right = relative.lower_equal_elem(RIGHT).float() * has_depth.clone();
        let opacity = said.maps.confidence.clone().clamp(1e-4, 1.0 - 1e-4);
        let entropy = -(right.clone() * opacity.clone().log() + (-right + 1.0) * (-opacity + 1.0).log());
        // Where there is no surface the opacity should be low as well: those pixels count a little.
        match &knows_surface {
            Some(known) => mean(entropy.flatten(0, 2), known.clone().flatten(0, 2)),
            None => entropy.mean(),
        }
    };
    let chord = |normal: Tensor<2>| {
        let difference = normal - normals.clone();
        // The chord itself, not its square as in the paper: squares pull towards the mean of the doubtful.
        let chord = (difference.powi_scalar(2).sum_dim(1) + 1e-4).sqrt();
        mean(chord.squeeze_dim::<1>(1), has_normal.clone())
    };
    let mut terms = vec![];
    let mut add = |name, known: bool, weight: f64, term: &dyn Fn() -> Option<Tensor<1>>| {
        if known && weight != 0.0 {
            terms.extend(term().map(|term| (name, weight, term)));
        }
    };
    let of_surfels = |which: usize| said.surfels.map(|surfels| chord(facing(surfels[which], sample, device)));
    let of_planes = || {
        let normals = said.maps.normals.clone()?;
        let count = sample.num_views() * sample.num_pixels();
        Some(chord(normals.permute([0, 2, 3, 1]).reshape([count, 3])))
    };
    add("depth", knows_depth, weights.depth, &|| Some(depth()));
    add("normal", knows_normals, weights.normal, &|| of_surfels(1));
    add("initial_normal", knows_normals, weights.initial_normal, &|| of_surfels(0));
    add("plane_normal", knows_normals, weights.plane_normal, &of_planes);
    add("choice", knows_depth, weights.choice, &|| {
        said.maps.choice.as_ref().map(|choice| divergence(choice, sample, weights.object_factor, device))
    });
    add("slope", knows_depth, weights.slope, &|| {
        let steps = |map: &Tensor<3>| map.clone() * inverse_step.clone();
        Some(slope(steps(&predicted), steps(&inverse_depth), has_depth.clone() * counts.clone()))
    });
    add("opacity", knows_depth, weights.opacity, &|| Some(opacity()));
    if let (Some([_, surfels]), true) = (said.surfels, weights.rendered.is_some()) {
        terms.extend(rendered::terms(surfels, sample, &weights.rendered, perceptual, device)?);
    }
    Ok(Terms(terms))
}

pub(crate) fn mean(values: Tensor<1>, mask: Tensor<1>) -> Tensor<1> {
    (values * mask.clone()).sum() / (mask.sum() + 1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::tests::analytic;
    use crate::truth::{Hole, TrueDepth, ViewTruth};
    use burn::tensor::TensorData;

    const WEIGHTS: LossWeights = LossWeights {
        depth: 1.0,
        normal: 1.0,
        initial_normal: 0.0,
        plane_normal: 1.0,
        choice: 0.0,
        slope: 1.0,
        opacity: 1.0,
        object_factor: 3.0,
        rendered: RenderedWeights {
            photometric: 0.0,
            perceptual: 0.0,
            alignment: 0.0,
            depth: 0.0,
            normal: 0.0,
            silhouette: 0.0,
            depth_ratio: 0.0,
            align_from: 0,
            context: 1.0,
        },
    };

    /// The terms for maps that are right everywhere but sure of it only where `sure` says so.
    fn named(sample: &Sample, truth: &Sample, sure: impl Fn(f32) -> bool) -> Vec<(&'static str, f64)> {
        let (device, (width, height)) = (Device::flex(), sample.size());
        let depths = || truth.truth.iter().flat_map(|view| (0..truth.num_pixels()).map(|i| view.depth_at(i)));
        let map = |values: Vec<f32>| -> Tensor<3> {
            Tensor::from_data(TensorData::new(values, [sample.num_views(), height, width]), &device)
        };
        let maps = EncoderMaps {
            depth: map(depths().map(|z| if z > 0.0 { z } else { 1.0 }).collect()),
            confidence: map(depths().map(|z| if sure(z) { 0.9 } else { 0.1 }).collect()),
            normals: Some(Tensor::zeros([sample.num_views(), 3, height, width], &device)),
            choice: None,
        };
        let said = Said { maps: &maps, surfels: None };
        terms(said, sample, &WEIGHTS, &Perceptual::Ssim, &device).unwrap().named()
    }

    #[test]
    fn terms_without_truth_are_absent_and_unmeasured_pixels_are_not_empty() {
        let mut rendered = analytic(3);
        let upper_half = |depth: &mut TrueDepth| (0..16).for_each(|y| (0..48).for_each(|x| depth.map[(x, y)] = 0.0));
        rendered.truth.iter_mut().for_each(|view| upper_half(view.depth.as_mut().unwrap()));
        let names = |sample: &Sample| named(sample, &rendered, |z| z > 0.0).iter().map(|t| t.0).collect::<Vec<_>>();
        assert_eq!(names(&rendered), ["depth", "plane_normal", "slope", "opacity"]);
        let mut sample = rendered.clone();
        sample.truth.iter_mut().for_each(|view| view.normal = None);
        assert_eq!(names(&sample), ["depth", "slope", "opacity"]);
        sample.truth[0] = ViewTruth::default();
        assert_eq!(names(&sample), ["depth", "slope", "opacity"]);
        sample.truth[1] = ViewTruth::default();
        assert!(names(&sample).is_empty());

        let opacity = |sample: &Sample, sure: fn(f32) -> bool| named(sample, &rendered, sure).last().unwrap().1;
        assert!(opacity(&rendered, |_| true) > opacity(&rendered, |z| z > 0.0) + 0.1);
        let mut measured = rendered.clone();
        measured.truth.iter_mut().for_each(|view| view.depth.as_mut().unwrap().hole = Hole::Unmeasured);
        assert_eq!(opacity(&measured, |_| true), opacity(&measured, |z| z > 0.0));
        assert!((opacity(&measured, |_| true) + 0.9f64.ln()).abs() < 1e-3);
    }
}
