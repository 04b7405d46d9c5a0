//! The judge of proposals as a kernel that burn differentiates through.
//!
//! Invariant: on the CPU and elsewhere it is the same function, whose hidden values only the CPU does without.

use super::conv2d;
use crate::ops::judge::{self, Inputs, Judge};
use crate::ops::kernel::{Kernel, SLOTS, run, runs_on};
use crate::ops::{count, relu};
use burn::tensor::Tensor;

fn inputs<'a>([known, context, weights, score, _]: &[&'a [f32]; SLOTS]) -> Inputs<'a> {
    Inputs { known, context, weights, score }
}

/// Inputs are what is known, the context, and the weights of the first and the second layer.
impl Kernel for Judge {
    fn shape(&self) -> Vec<usize> {
        vec![self.views, self.proposals, self.pixels]
    }

    fn forward(&self, slots: &[&[f32]; SLOTS]) -> Vec<f32> {
        judge::forward(self, &inputs(slots))
    }

    fn backward(&self, slots: &[&[f32]; SLOTS], grad: &[f32], _: [bool; SLOTS]) -> [Option<Vec<f32>>; SLOTS] {
        // All four come of the same pass.
        let grads = judge::backward(self, &inputs(slots), grad);
        [Some(grads.known), Some(grads.context), Some(grads.weights), Some(grads.score), None]
    }
}

/// Scores `[views, proposals, h, w]` of what is `known`, `[views, proposals, channels, h, w]`: the second layer
/// `[hidden]` of the positive part of the first, `[hidden, channels]`, and of the `context`, `[views, hidden, h, w]`.
pub(crate) fn judged(known: Tensor<5>, context: Tensor<4>, weights: Tensor<2>, score: Tensor<1>) -> Tensor<4> {
    let ([views, proposals, channels, height, width], [hidden, _]) = (known.dims(), weights.dims());
    let device = known.device();
    if !runs_on(&device) {
        return by_layers(known, context, weights, score);
    }
    count::tell_product(&[views, proposals, height, width, hidden, channels + 1]);
    let judge = Judge { views, proposals, channels, hidden, pixels: height * width };
    let [known, context] = [known.into_dispatch(), context.into_dispatch()];
    let scores: Tensor<3> = run(&device, [known, context, weights.into_dispatch(), score.into_dispatch()], judge);
    scores.reshape([views, proposals, height, width])
}

/// The same by convolutions, which every device has.
fn by_layers(known: Tensor<5>, context: Tensor<4>, weights: Tensor<2>, score: Tensor<1>) -> Tensor<4> {
    let ([views, proposals, channels, height, width], [hidden, _]) = (known.dims(), weights.dims());
    let layer = |maps: Tensor<4>, weights: Tensor<4>| conv2d(maps, weights, None, 1, 0);
    let known = known.reshape([views * proposals, channels, height, width]);
    let first: Tensor<5> =
        layer(known, weights.reshape([hidden, channels, 1, 1])).reshape([views, proposals, hidden, height, width]);
    let values: Tensor<4> = relu(first + context.unsqueeze_dim(1)).flatten(0, 1);
    layer(values, score.reshape([1, hidden, 1, 1])).reshape([views, proposals, height, width])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::values;
    use burn::tensor::{Device, TensorData};

    #[test]
    fn without_hidden_maps_it_is_the_same_function_and_so_are_its_gradients() {
        let device = Device::flex().autodiff();
        let wave = |count: usize, speed: f32| {
            let values: Vec<f32> = (0..count).map(|i| (i as f32 * speed + 0.6).sin()).collect();
            Tensor::<1>::from_data(TensorData::new(values, [count]), &device).require_grad()
        };
        // The last has more pixels than a task, and not a whole number of groups.
        for [views, proposals, channels, hidden, height, width] in
            [[1, 1, 1, 1, 1, 1], [2, 5, 7, 4, 3, 5], [2, 3, 4, 6, 19, 31]]
        {
            let known = wave(views * proposals * channels * height * width, 1.7);
            let context = wave(views * hidden * height * width, 2.3);
            let (weights, score) = (wave(hidden * channels, 0.9), wave(hidden, 3.1));
            let answer = |judge: fn(Tensor<5>, Tensor<4>, Tensor<2>, Tensor<1>) -> Tensor<1>| {
                let scores = judge(
                    known.clone().reshape([views, proposals, channels, height, width]),
                    context.clone().reshape([views, hidden, height, width]),
                    weights.clone().reshape([hidden, channels]),
                    score.clone(),
                );
                let gradients = (scores.clone() * wave(scores.dims()[0], 4.7)).sum().backward();
                let of = |input: &Tensor<1>| values(input.grad(&gradients).unwrap());
                [values(scores), of(&known), of(&context), of(&weights), of(&score)]
            };
            let expected =
                answer(|known, context, weights, score| by_layers(known, context, weights, score).flatten(0, 3));
            let found = answer(|known, context, weights, score| judged(known, context, weights, score).flatten(0, 3));
            for (expected, found) in expected.iter().zip(&found) {
                assert_eq!(expected.len(), found.len());
                let largest = expected.iter().fold(0.0f32, |most, value| most.max(value.abs()));
                assert!(largest > 0.0, "nothing was compared");
                for (expected, found) in expected.iter().zip(found) {
                    assert!((expected - found).abs() < 1e-5 * largest.max(1.0), "{found} instead of {expected}");
                }
            }
        }
    }
}
