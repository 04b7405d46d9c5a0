//! What the network is taught: planes, orientations and honesty, from exact truth (spec 4.3).
//!
//! Depth errors are counted in steps (about a pixel of parallax), so every term is free of units. Invariants: pixels
//! whose truth is not known say nothing, and a term of which nothing is known is left out; the truth itself has loss
//! zero but for the opacity term, whose least value is reached by the true probability of being right.

use crate::choice;
use crate::error::TrainError;
use crate::facing::facing;
use crate::rendered;
use crate::sample::Sample;
use crate::truth_tensors::TruthTensors;
use burn::tensor::{Device, Tensor, TensorData};
use surfel_loss::{Perceptual, Terms, calibrated_opacity, chord, depth_in_steps, opacity, slope};
use surfel_net::{EncoderMaps, Prediction, SurfelTensors};

pub use crate::loss_weights::LossWeights;

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
    let knows = |known: bool, weight: f64| if known { weight } else { 0.0 };
    let of_depth = |weight| knows(sample.truth.iter().any(|view| view.depth.is_some()), weight);
    let of_normals = |weight| knows(sample.truth.iter().any(|view| view.normal.is_some()), weight);
    let TruthTensors { inverse_depth, has_depth, knows_surface, inverse_step, normals, has_normal, counts } = truth;
    let predicted = said.maps.depth.clone().recip();
    let in_steps = |map: Tensor<3>| map * inverse_step.clone();
    let counts = || has_depth.clone() * counts.clone();
    let chord = |of: Tensor<2>| chord(of, normals.clone(), has_normal.clone());

    let mut terms = Terms::default();
    terms.add("depth", of_depth(weights.depth), || {
        depth_in_steps(in_steps(predicted.clone() - inverse_depth.clone()), counts())
    });
    terms.add("range_depth", of_depth(weights.range_depth), || range_depth(&said.maps.depth, sample, device));
    if let Some([initial, surfels]) = said.surfels {
        terms.add("normal", of_normals(weights.normal), || chord(facing(surfels, sample, device)));
        terms.add("initial_normal", of_normals(weights.initial_normal), || chord(facing(initial, sample, device)));
    }
    if let Some(planes) = &said.maps.normals {
        let count = sample.num_views() * sample.num_pixels();
        let planes = || planes.clone().permute([0, 2, 3, 1]).reshape([count, 3]);
        terms.add("plane_normal", of_normals(weights.plane_normal), || chord(planes()));
    }
    if let Some(proposals) = &said.maps.choice {
        let of_blocks = || choice::of_blocks(proposals, sample, weights.object_factor, device);
        terms.add("choice", of_depth(weights.choice), of_blocks);
    }
    terms.add("slope", of_depth(weights.slope), || {
        slope(in_steps(predicted.clone()), in_steps(inverse_depth.clone()), counts())
    });
    terms.add("opacity", of_depth(weights.opacity), || {
        let relative_error = (inverse_depth.clone() / predicted.clone().detach() - 1.0).abs();
        calibrated_opacity(said.maps.confidence.clone(), relative_error, has_depth.clone(), knows_surface.clone())
    });
    if let Some([_, surfels]) = said.surfels {
        terms.add("decided_opacity", weights.decided_opacity, || opacity(surfels.opacities.clone()));
        if weights.rendered.is_some() {
            terms.list.extend(rendered::terms(surfels, sample, &weights.rendered, perceptual, device)?);
        }
    }
    Ok(terms)
}

/// [`surfel_loss::depth`] of the encoder's depth, mean over the views that know theirs.
fn range_depth(depth: &Tensor<3>, sample: &Sample, device: &Device) -> Tensor<1> {
    let (width, height) = sample.size();
    let of_view = |view: usize| {
        let truth = sample.truth[view].depth.as_ref()?.map.as_slice().to_vec();
        let truth: Tensor<2> = Tensor::from_data(TensorData::new(truth, [height, width]), device);
        let predicted = depth.clone().narrow(0, view, 1).squeeze_dim::<2>(0);
        Some(surfel_loss::depth(predicted, truth, &sample.ranges[view]))
    };
    let of_views: Vec<Tensor<1>> = (0..sample.num_views()).filter_map(of_view).collect();
    Tensor::cat(of_views, 0).mean()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::tests::analytic;
    use crate::truth::{Hole, TrueDepth, ViewTruth};

    fn weights() -> LossWeights {
        let text = "depth = 1.0\nrange_depth = 1.0\nnormal = 1.0\ninitial_normal = 0.0\nplane_normal = 1.0\nslope = 1.0\n\
            opacity = 1.0\nobject_factor = 3.0";
        toml::from_str(text).unwrap()
    }

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
        terms(said, sample, &weights(), &Perceptual::Ssim, &device).unwrap().named()
    }

    #[test]
    fn terms_without_truth_are_absent_and_unmeasured_pixels_are_not_empty() {
        let mut rendered = analytic(3);
        let upper_half = |depth: &mut TrueDepth| (0..16).for_each(|y| (0..48).for_each(|x| depth.map[(x, y)] = 0.0));
        rendered.truth.iter_mut().for_each(|view| upper_half(view.depth.as_mut().unwrap()));
        let names = |sample: &Sample| named(sample, &rendered, |z| z > 0.0).iter().map(|t| t.0).collect::<Vec<_>>();
        assert_eq!(names(&rendered), ["depth", "range_depth", "plane_normal", "slope", "opacity"]);
        let mut sample = rendered.clone();
        sample.truth.iter_mut().for_each(|view| view.normal = None);
        assert_eq!(names(&sample), ["depth", "range_depth", "slope", "opacity"]);
        sample.truth[0] = ViewTruth::default();
        assert_eq!(names(&sample), ["depth", "range_depth", "slope", "opacity"]);
        sample.truth[1] = ViewTruth::default();
        assert!(names(&sample).is_empty());

        let opacity = |sample: &Sample, sure: fn(f32) -> bool| named(sample, &rendered, sure).last().unwrap().1;
        assert!(opacity(&rendered, |_| true) > opacity(&rendered, |z| z > 0.0) + 0.1);
        let mut measured = rendered.clone();
        measured.truth.iter_mut().for_each(|view| view.depth.as_mut().unwrap().hole = Hole::Unmeasured);
        assert_eq!(opacity(&measured, |_| true), opacity(&measured, |z| z > 0.0));
        assert!((opacity(&measured, |_| true) + 0.9f64.ln()).abs() < 1e-3);
    }

    #[test]
    fn depth_of_the_encoder_is_compared_in_shares_of_the_range() {
        let (sample, device) = (analytic(3), Device::flex());
        let range = sample.ranges[0];
        let depths = sample.truth.iter().flat_map(|view| view.depth.as_ref().unwrap().map.as_slice()).copied();
        let depths: Vec<f32> = depths.map(|z| z + 0.1 * (range.far - range.near) as f32).collect();
        let depth = || Tensor::from_data(TensorData::new(depths.clone(), [2, 32, 48]), &device);
        let value = |sample: &Sample| f64::from(range_depth(&depth(), sample, &device).into_scalar::<f32>());
        assert!((value(&sample) - (0.9 * 0.1 + 0.1 * 0.01)).abs() < 1e-4, "{}", value(&sample));
        // A view of which nothing is known does not dilute the other.
        let mut half = sample.clone();
        half.truth[1] = ViewTruth::default();
        assert!((value(&half) - value(&sample)).abs() < 1e-4);
    }
}
