//! How much each proposed plane is believed: one small judge for all proposals.
//!
//! What is known of a proposal (agreement of photographs and features, distance to the pixel's own plane,
//! confidence, support by the others) and the context of the pixel go through the same two layers whoever
//! proposes. Invariant: renaming the proposals renames the scores, and a fresh judge finds them all equal.

use crate::layers::Conv2d;
use crate::layers::conv1x1;
use burn::module::{Module, Param};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

/// Width of the judge.
const HIDDEN: usize = 8;
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
        let [views, count, channels, height, width] = known.dims();
        let known: Tensor<4> = known.reshape([views * count, channels, height, width]);
        let known: Tensor<5> = self.proposal.forward(known).reshape([views, count, HIDDEN, height, width]);
        let context: Tensor<5> = self.context.forward(context).reshape([views, 1, HIDDEN, height, width]);
        let hidden: Tensor<4> = relu(known + context).reshape([views * count, HIDDEN, height, width]);
        self.score.forward(hidden).reshape([views, count, height, width]) * GAIN
    }
}
