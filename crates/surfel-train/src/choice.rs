//! How wrong the planes are that a seeded network chooses from, as [`surfel_loss::choice`] asks for it.
//!
//! Invariant: a block is judged at the pixel that the network says, where its proposals are given.

use crate::sample::Sample;
use burn::tensor::{Device, Tensor, TensorData};
use surfel_loss::choice;
use surfel_net::Choice;

/// The choice term over the blocks of `sample`; those of objects count `object_factor` times.
pub(crate) fn of_blocks(proposals: &Choice, sample: &Sample, object_factor: f64, device: &Device) -> Tensor<1> {
    let ((width, height), stride) = (sample.size(), proposals.stride());
    let (columns, rows, views) = (width / stride, height / stride, sample.num_views());
    let inside = |map: Tensor<4>| map.narrow(2, 0, rows).narrow(3, 0, columns);
    let (mut truth, mut counts) = (Vec::new(), Vec::new());
    for known in &sample.truth {
        for block in 0..rows * columns {
            let (x, y) = proposals.judged_pixel(block % columns, block / columns);
            let pixel = y * width + x;
            let (depth, count) =
                (known.depth_at(pixel), if known.is_object(pixel) { object_factor as f32 } else { 1.0 });
            truth.push(if depth > 0.0 { 1.0 / depth } else { 0.0 });
            counts.push(if depth > 0.0 { count } else { 0.0 });
        }
    }
    let maps = |values: Vec<f32>| -> Tensor<4> {
        Tensor::from_data(TensorData::new(values, [views, 1, rows, columns]), device)
    };
    let steps: Vec<f32> = sample.steps().iter().map(|step| 1.0 / step).collect();
    let inverse_step = Tensor::from_data(TensorData::new(steps, [views, 1, 1, 1]), device);
    let errors = (inside(proposals.proposed()) - maps(truth)) * inverse_step;
    choice(inside(proposals.judged_scores()), errors, maps(counts))
}
