//! Which of the proposed planes is right: the term that teaches a seeded network to choose.
//!
//! The depth term reaches the scores only through the softmax, where a plane that is hardly believed hardly learns;
//! this one tells every score what it should be. Invariant: zero when the belief equals the target, and a block for
//! which nobody proposes anything right says nothing.

use crate::loss::mean;
use crate::sample::Sample;
use burn::tensor::activation::{log_softmax, softmax};
use burn::tensor::{Device, Tensor, TensorData};
use surfel_net::Choice;

/// Error, in steps, by which a plane must be worse to be believed `e` times less.
const TOLERANCE_STEPS: f64 = 0.1;
/// Largest error of the best proposal of a block that has one, steps.
const RIGHT_STEPS: f64 = 1.5;
/// Largest error that counts, steps.
const LARGEST_STEPS: f64 = 16.0;

/// Divergence of the belief in the proposed planes from what the truth of `sample` says of them, mean over blocks;
/// those of objects count `object_factor` times.
pub(crate) fn divergence(choice: &Choice, sample: &Sample, object_factor: f64, device: &Device) -> Tensor<1> {
    let (width, height) = sample.size();
    let (columns, rows, views) = (width / choice.stride, height / choice.stride, sample.num_views());
    let inside = |map: Tensor<4>| map.narrow(2, 0, rows).narrow(3, 0, columns);
    let (mut truth, mut counts) = (Vec::new(), Vec::new());
    for known in &sample.truth {
        for block in 0..rows * columns {
            let pixel = block / columns * choice.stride * width + block % columns * choice.stride;
            truth.push(known.depth_at(pixel));
            counts.push(if known.is_object(pixel) { object_factor as f32 } else { 1.0 });
        }
    }
    let of_blocks = |values: Vec<f32>| -> Tensor<4> {
        Tensor::from_data(TensorData::new(values, [views, 1, rows, columns]), device)
    };
    let known = truth.iter().zip(&counts).map(|(z, count)| if *z > 0.0 { *count } else { 0.0 });
    let known = of_blocks(known.collect());
    let truth = of_blocks(truth.iter().map(|z| if *z > 0.0 { 1.0 / z } else { 0.0 }).collect());
    let steps: Vec<f32> = sample.seeds.iter().map(|seed| 1.0 / seed.step).collect();
    let inverse_step = Tensor::from_data(TensorData::new(steps, [views, 1, 1, 1]), device);
    let errors = ((inside(choice.proposed()) - truth) * inverse_step).abs().clamp_max(LARGEST_STEPS);
    let mask = known * errors.clone().min_dim(1).lower_elem(RIGHT_STEPS).float();
    let target = softmax(-errors.clone() / TOLERANCE_STEPS, 1);
    let log_target = log_softmax(-errors / TOLERANCE_STEPS, 1);
    let belief = log_softmax(inside(choice.scores.clone()), 1);
    let divergence = (target * (log_target - belief)).sum_dim(1);
    mean(divergence.flatten(0, 3), mask.flatten(0, 3))
}
