//! The truth of all views of a sample as tensors, as the terms on the encoder's maps ask for it.
//!
//! Invariant: where something is not known its mask is 0 and its value is finite, so that it adds nothing.

use crate::sample::Sample;
use burn::tensor::{Device, Tensor, TensorData};

/// What is true of the pixels of a sample.
pub(crate) struct TruthTensors {
    /// 1 / true z-depth, 1 / scene unit, 1 where there is none, `[views, height, width]`.
    pub inverse_depth: Tensor<3>,
    /// 1 where there is a true depth, `[views, height, width]`.
    pub has_depth: Tensor<3>,
    /// 1 where it is known whether there is a surface, `[views, height, width]`; `None` where it is everywhere.
    pub knows_surface: Option<Tensor<3>>,
    /// 1 / step of a view, scene units, `[views, 1, 1]`.
    pub inverse_step: Tensor<3>,
    /// True unit normals, camera frame, facing the camera, `[views * height * width, 3]`.
    pub normals: Tensor<2>,
    /// 1 where there is a true normal, `[views * height * width]`.
    pub has_normal: Tensor<1>,
    /// How much each pixel counts in depth and choice, `[views, height, width]`.
    pub counts: Tensor<3>,
}

impl TruthTensors {
    /// Of `sample`; pixels of objects count `object_factor` times.
    pub(crate) fn of(sample: &Sample, object_factor: f64, device: &Device) -> Self {
        let (width, height) = sample.size();
        let (views, pixels) = (sample.num_views(), sample.num_pixels());
        let places = || (0..views).flat_map(|view| (0..pixels).map(move |pixel| (&sample.truth[view], pixel)));
        let tensor = |values: Vec<f32>| -> Tensor<3> {
            Tensor::from_data(TensorData::new(values, [views, height, width]), device)
        };
        let flag = |is: bool| if is { 1.0 } else { 0.0 };
        let depths = || places().map(|(truth, pixel)| truth.depth_at(pixel));
        let knows: Vec<f32> = places().map(|(truth, pixel)| flag(truth.knows_surface_at(pixel))).collect();
        let normals: Vec<f32> =
            places().flat_map(|(truth, pixel)| truth.normal_at(pixel).unwrap_or([0.0; 3])).collect();
        let has_normal: Vec<f32> = places().map(|(truth, pixel)| flag(truth.normal_at(pixel).is_some())).collect();
        let count = |is_object: bool| if is_object { object_factor as f32 } else { 1.0 };
        let steps: Vec<f32> = sample.steps().iter().map(|step| 1.0 / step).collect();
        Self {
            inverse_depth: tensor(depths().map(|z| if z > 0.0 { 1.0 / z } else { 1.0 }).collect()),
            has_depth: tensor(depths().map(|z| flag(z > 0.0)).collect()),
            knows_surface: knows.contains(&0.0).then(|| tensor(knows)),
            inverse_step: Tensor::from_data(TensorData::new(steps, [views, 1, 1]), device),
            normals: Tensor::from_data(TensorData::new(normals, [views * pixels, 3]), device),
            has_normal: Tensor::from_data(TensorData::new(has_normal, [views * pixels]), device),
            counts: tensor(places().map(|(truth, pixel)| count(truth.is_object(pixel))).collect()),
        }
    }
}
