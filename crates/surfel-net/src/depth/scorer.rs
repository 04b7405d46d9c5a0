//! How much each proposed plane is believed: one small judge for all proposals.
//!
//! What is known of a proposal (agreement of photographs and features, distance to the pixel's own plane,
//! confidence, support by the others, likeness of the proposer) and the context of the pixel go through the same two
//! layers whoever proposes. Invariant: renaming the proposals renames the scores, and a fresh judge finds them all
//! equal.

use crate::layers::Conv2d;
use crate::layers::conv1x1;
use crate::ops::judged;
use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};

/// Width of the judge.
const HIDDEN: usize = 32;
/// Score of an output of one: enough to overrule a pixel's head start within some hundred steps of training.
const GAIN: f64 = 10.0;

/// The judge.
#[derive(Module, Debug)]
pub(crate) struct Scorer {
    proposal: Conv2d,
    context: Conv2d,
    score: Conv2d,
}

impl Scorer {
    pub(crate) fn new(proposal_channels: usize, context_channels: usize, device: &Device) -> Self {
        let mut score = conv1x1(HIDDEN, 1, device);
        score.weight = Param::from_tensor(score.weight.val().zeros_like());
        score.bias = score.bias.map(|bias| Param::from_tensor(bias.val().zeros_like()));
        Self {
            proposal: conv1x1(proposal_channels, HIDDEN, device),
            context: conv1x1(context_channels, HIDDEN, device),
            score,
        }
    }

    /// Scores `[views, proposals, h, w]` of `known` `[views, proposals, channels, h, w]` in `context`
    /// `[views, channels, h, w]`.
    pub(crate) fn forward(&self, known: Tensor<5>, context: Tensor<4>) -> Tensor<4> {
        // One number per channel, added wherever the channel is.
        let added = |layer: &Conv2d| layer.bias.as_ref().map(|bias| bias.val().reshape([1, -1, 1, 1]));
        let plus = |map: Tensor<4>, layer: &Conv2d| added(layer).into_iter().fold(map, |map, bias| map + bias);
        let context = plus(self.context.forward(context), &self.proposal);
        let [weights, score] = [&self.proposal, &self.score].map(|layer| layer.weight.val());
        plus(judged(known, context, weights.flatten(1, 3), score.flatten(0, 3)), &self.score) * GAIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Distribution;

    const SIZE: [usize; 2] = [2, 3];

    /// A judge, what is known of five proposals in each of two views, and a context.
    fn case(device: &Device) -> (Scorer, Tensor<5>, Tensor<4>) {
        let [h, w] = SIZE;
        let uniform = Distribution::Uniform(-1.0, 1.0);
        let known = Tensor::random([2, 5, 7, h, w], uniform, device);
        (Scorer::new(7, 4, device), known, Tensor::random([2, 4, h, w], uniform, device))
    }

    fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
        tensor.into_data().try_to_vec().unwrap()
    }

    #[test]
    fn renaming_the_proposals_renames_the_scores() {
        let device = Device::flex();
        let (mut judge, known, context) = case(&device);
        // A fresh judge would make the test vacuous.
        judge.score = conv1x1(HIDDEN, 1, &device);
        let names = Tensor::from_ints([3, 0, 4, 1, 2], &device);
        let scores = judge.forward(known.clone(), context.clone());
        let renamed = values(judge.forward(known.select(1, names.clone()), context));
        let expected = values(scores.clone().select(1, names));
        let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(close(&renamed, &expected), "{renamed:?} are not {expected:?}");
        assert!(!close(&renamed, &values(scores)), "all proposals score alike: nothing was tested");
    }

    #[test]
    fn a_fresh_judge_scores_all_proposals_alike() {
        let (judge, known, context) = case(&Device::flex());
        let scores = judge.forward(known, context);
        assert_eq!(scores.dims(), [2, 5, SIZE[0], SIZE[1]]);
        let first = scores.clone().narrow(1, 0, 1);
        assert!(values(scores - first).iter().all(|difference| *difference == 0.0));
    }
}
