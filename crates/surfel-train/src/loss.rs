//! What the network is taught: planes, orientations and honesty, from exact truth (spec 4.3).
//!
//! Depth errors are counted in steps (about a pixel of parallax), so every term is free of units; pixels without
//! truth say nothing. Invariant: the truth itself has loss zero but for the opacity term, whose least value is
//! reached by the true probability of being right.

use crate::sample::Sample;
use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};
use surfel_core::Grid;
use surfel_net::{Prediction, SurfelTensors};

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
    /// Opacity as the probability that the depth is right.
    pub opacity: f64,
}

/// The terms of one sample, each a scalar tensor, unweighted.
pub struct Terms {
    /// Mean robust error in steps.
    pub depth: Tensor<1>,
    /// Mean chord between unit normals.
    pub normal: Tensor<1>,
    /// The same of the initial surfels.
    pub initial_normal: Tensor<1>,
    /// Mean cross-entropy of the opacity.
    pub opacity: Tensor<1>,
}

impl Terms {
    /// The weighted sum.
    pub fn total(&self, weights: &LossWeights) -> Tensor<1> {
        self.depth.clone() * weights.depth
            + self.normal.clone() * weights.normal
            + self.initial_normal.clone() * weights.initial_normal
            + self.opacity.clone() * weights.opacity
    }

    /// Name and value of each.
    pub fn named(&self) -> Vec<(&'static str, f64)> {
        let value = |term: &Tensor<1>| f64::from(term.clone().into_scalar::<f32>());
        vec![
            ("depth", value(&self.depth)),
            ("normal", value(&self.normal)),
            ("initial_normal", value(&self.initial_normal)),
            ("opacity", value(&self.opacity)),
        ]
    }
}

/// Error, in steps, below which the depth loss is nearly linear and above which it grows ever slower.
const KNEE_STEPS: f64 = 0.5;
/// Share of the plain absolute error, which keeps large mistakes worth mending.
const LINEAR: f64 = 0.1;
/// Largest error that counts, steps.
const LARGEST_STEPS: f64 = 16.0;
/// Relative depth error up to which a pixel counts as right.
const RIGHT: f64 = 0.01;

/// The terms of a prediction of `sample`.
pub fn terms(prediction: &Prediction, sample: &Sample, device: &Device) -> Terms {
    let truth = Truth::of(sample, device);
    let Truth { inverse_depth, mask, inverse_step, normals, normal_mask } = truth;
    let predicted = prediction.depth.clone().recip();
    let error = ((predicted.clone() - inverse_depth.clone()) * inverse_step).abs().clamp_max(LARGEST_STEPS);
    let robust = (error.clone() / KNEE_STEPS).log1p() * KNEE_STEPS + error * LINEAR;
    let relative = (inverse_depth.clone() / predicted.detach() - 1.0).abs();
    let right = relative.lower_equal_elem(RIGHT).float() * mask.clone();
    let opacity = prediction.confidence.clone().clamp(1e-4, 1.0 - 1e-4);
    let entropy = -(right.clone() * opacity.clone().log() + (-right + 1.0) * (-opacity + 1.0).log());
    // Where there is no surface the opacity should be low as well: those pixels count a little.
    let normal = |surfels: &SurfelTensors| {
        let difference = facing(surfels, sample, device) - normals.clone();
        // The chord itself, not its square as in the paper: squares pull towards the mean of the doubtful.
        let chord = (difference.powi_scalar(2).sum_dim(1) + 1e-4).sqrt();
        mean(chord.squeeze_dim::<1>(1), normal_mask.clone())
    };
    Terms {
        depth: mean(robust.flatten(0, 2), mask.flatten(0, 2)),
        normal: normal(&prediction.surfels),
        initial_normal: normal(&prediction.initial),
        opacity: entropy.mean(),
    }
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

fn mean(values: Tensor<1>, mask: Tensor<1>) -> Tensor<1> {
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
