//! What the network is taught: planes, orientations and honesty, from exact truth (spec 4.3).
//!
//! Depth errors are counted in steps (about a pixel of parallax), so every term is free of units; pixels without
//! truth say nothing. Invariant: the truth itself has loss zero but for the opacity term, whose least value is
//! reached by the true probability of being right.

use crate::choice::divergence;
use crate::error::TrainError;
use crate::rendered::{self, RenderedWeights};
use crate::sample::Sample;
use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};
use surfel_core::Grid;
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

/// The terms of what is `said` of `sample` that have a weight.
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
    let truth = Truth::of(sample, device);
    let Truth { inverse_depth, mask, inverse_step, normals, normal_mask } = truth;
    let counts = object_counts(sample, weights.object_factor, device);
    let predicted = said.maps.depth.clone().recip();
    let depth = || {
        let error = ((predicted.clone() - inverse_depth.clone()) * inverse_step.clone()).abs();
        let error = error.clamp_max(LARGEST_STEPS);
        let robust = (error.clone() / KNEE_STEPS).log1p() * KNEE_STEPS + error * LINEAR;
        mean(robust.flatten(0, 2), (mask.clone() * counts.clone()).flatten(0, 2))
    };
    let opacity = || {
        let relative = (inverse_depth.clone() / predicted.clone().detach() - 1.0).abs();
        let right = relative.lower_equal_elem(RIGHT).float() * mask.clone();
        let opacity = said.maps.confidence.clone().clamp(1e-4, 1.0 - 1e-4);
        let entropy = -(right.clone() * opacity.clone().log() + (-right + 1.0) * (-opacity + 1.0).log());
        // Where there is no surface the opacity should be low as well: those pixels count a little.
        entropy.mean()
    };
    let chord = |normal: Tensor<2>| {
        let difference = normal - normals.clone();
        // The chord itself, not its square as in the paper: squares pull towards the mean of the doubtful.
        let chord = (difference.powi_scalar(2).sum_dim(1) + 1e-4).sqrt();
        mean(chord.squeeze_dim::<1>(1), normal_mask.clone())
    };
    let mut terms = vec![];
    let mut add = |name, weight: f64, term: &dyn Fn() -> Option<Tensor<1>>| {
        if weight != 0.0 {
            terms.extend(term().map(|term| (name, weight, term)));
        }
    };
    let of_surfels = |which: usize| said.surfels.map(|surfels| chord(facing(surfels[which], sample, device)));
    let of_planes = || {
        let normals = said.maps.normals.clone()?;
        let count = sample.num_views() * sample.depth[0].len();
        Some(chord(normals.permute([0, 2, 3, 1]).reshape([count, 3])))
    };
    add("depth", weights.depth, &|| Some(depth()));
    add("normal", weights.normal, &|| of_surfels(1));
    add("initial_normal", weights.initial_normal, &|| of_surfels(0));
    add("plane_normal", weights.plane_normal, &of_planes);
    add("choice", weights.choice, &|| {
        said.maps.choice.as_ref().map(|choice| divergence(choice, sample, weights.object_factor, device))
    });
    add("opacity", weights.opacity, &|| Some(opacity()));
    if let Some([_, surfels]) = said.surfels {
        terms.extend(rendered::terms(surfels, sample, &weights.rendered, perceptual, device)?);
    }
    Ok(Terms(terms))
}

/// How much each pixel counts, `[views, height, width]`.
fn object_counts(sample: &Sample, factor: f64, device: &Device) -> Tensor<3> {
    let (width, height) = sample.size();
    let objects = sample.object.iter().flat_map(Grid::as_slice);
    let counts: Vec<f32> = objects.map(|is| if *is { factor as f32 } else { 1.0 }).collect();
    Tensor::from_data(TensorData::new(counts, [sample.num_views(), height, width]), device)
}

struct Truth {
    inverse_depth: Tensor<3>,
    mask: Tensor<3>,
    inverse_step: Tensor<3>,
    normals: Tensor<2>,
    normal_mask: Tensor<1>,
}

impl Truth {
    fn of(sample: &Sample, device: &Device) -> Self {
        let (width, height) = sample.size();
        let views = sample.num_views();
        let maps = |value: &dyn Fn(f32) -> f32| -> Tensor<3> {
            let values: Vec<f32> = sample.depth.iter().flat_map(Grid::as_slice).map(|z| value(*z)).collect();
            Tensor::from_data(TensorData::new(values, [views, height, width]), device)
        };
        let steps: Vec<f32> = sample.seeds.iter().map(|seed| 1.0 / seed.step).collect();
        let normals: Vec<f32> = sample.normal.iter().flat_map(|map| map.as_slice().as_flattened()).copied().collect();
        let known: Vec<f32> =
            normals.as_chunks::<3>().0.iter().map(|n| if *n == [0.0; 3] { 0.0 } else { 1.0 }).collect();
        let count = views * width * height;
        Self {
            inverse_depth: maps(&|z| if z > 0.0 { 1.0 / z } else { 1.0 }),
            mask: maps(&|z| if z > 0.0 { 1.0 } else { 0.0 }),
            inverse_step: Tensor::from_data(TensorData::new(steps, [views, 1, 1]), device),
            normals: Tensor::from_data(TensorData::new(normals, [count, 3]), device),
            normal_mask: Tensor::from_data(TensorData::new(known, [count]), device),
        }
    }
}

pub(crate) fn mean(values: Tensor<1>, mask: Tensor<1>) -> Tensor<1> {
    (values * mask.clone()).sum() / (mask.sum() + 1e-6)
}

/// Normals of surfels `[surfels, 3]` in the camera of their own view, turned to face it.
fn facing(surfels: &SurfelTensors, sample: &Sample, device: &Device) -> Tensor<2> {
    let [w, x, y, z] = [0, 1, 2, 3].map(|i| surfels.rotations.clone().narrow(1, i, 1));
    let mul = |a: &Tensor<2>, b: &Tensor<2>| a.clone() * b.clone();
    let world = Tensor::cat(
        vec![
            (mul(&x, &z) + mul(&w, &y)) * 2.0,
            (mul(&y, &z) - mul(&w, &x)) * 2.0,
            (mul(&x, &x) + mul(&y, &y)) * -2.0 + 1.0,
        ],
        1,
    );
    let views = sample.num_views();
    let pixels = sample.depth[0].len();
    // Columns of `camera_from_world` one after the other are its transpose, row by row, as row vectors need it.
    let columns = sample.cameras.iter().flat_map(|camera| camera.camera_from_world.rotation.to_cols_array());
    let transposed: Vec<f32> = columns.map(|value| value as f32).collect();
    let transposed: Tensor<3> = Tensor::from_data(TensorData::new(transposed, [views, 3, 3]), device);
    let in_camera = world.reshape([views, pixels, 3]).matmul(transposed);
    let rays: Vec<f32> = sample
        .cameras
        .iter()
        .flat_map(|camera| {
            let pixels = (0..pixels).map(|i| surfel_core::Camera::pixel_centre(i % camera.width, i / camera.width));
            pixels.flat_map(|pixel| camera.ray(pixel).as_vec3().to_array()).collect::<Vec<_>>()
        })
        .collect();
    let rays: Tensor<3> = Tensor::from_data(TensorData::new(rays, [views, pixels, 3]), device);
    let away = (in_camera.clone().detach() * rays).sum_dim(2).greater_elem(0.0).float();
    let sign = away * -2.0 + 1.0;
    (in_camera * sign).reshape([views * pixels, 3])
}
