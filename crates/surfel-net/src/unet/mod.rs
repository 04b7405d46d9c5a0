//! The U-Net of the cost volume and of the refinement (spec 2.6).
//!
//! Invariant: fresh residual blocks and attentions are the identity (their last normalisation starts at
//! zero), and views are treated alike.

pub(crate) mod attention;
mod residual;

use crate::config::UnetConfig;
use crate::layers::{Conv2d, conv_config, conv3x3, group_norm, nearest};
use crate::ops::{Activation, group_norm as normed};
use attention::ViewAttention;
use burn::module::Module;
use burn::nn::GroupNorm;
use burn::tensor::{Device, Int, Tensor};
use residual::ResidualBlock;

/// A residual block and, at some resolutions, attention between views.
#[derive(Module, Debug)]
struct Step {
    block: ResidualBlock,
    attention: Option<ViewAttention>,
}

impl Step {
    fn forward(&self, x: Tensor<4>, sources: &Tensor<2, Int>) -> Tensor<4> {
        let x = self.block.forward(x);
        match &self.attention {
            Some(attention) => attention.forward(x, sources),
            None => x,
        }
    }
}

/// The network; levels finest first.
#[derive(Module, Debug)]
pub(crate) struct Unet {
    enter: Conv2d,
    down: Vec<Step>,
    shrink: Vec<Conv2d>,
    middle: [ResidualBlock; 2],
    /// Two steps per level, deepest level first.
    up: Vec<Step>,
    grow: Vec<Conv2d>,
    leave: Conv2d,
    leave_norm: GroupNorm,
}

impl Unet {
    pub(crate) fn new(config: &UnetConfig, device: &Device) -> Self {
        let base = config.channels;
        let widths: Vec<usize> = config.multipliers.iter().map(|m| base * m).collect();
        let step = |inputs, level: usize| Step {
            block: ResidualBlock::new(inputs, widths[level], device),
            attention: config.attention_at.contains(&(1 << level)).then(|| ViewAttention::new(widths[level], device)),
        };
        let (mut down, mut shrink, mut skips, mut channels) = (Vec::new(), Vec::new(), vec![base], base);
        for level in 0..widths.len() {
            down.push(step(channels, level));
            channels = widths[level];
            skips.push(channels);
            if level + 1 < widths.len() {
                shrink.push(conv_config(channels, channels, 3).with_stride(2).init(device));
                skips.push(channels);
            }
        }
        let middle = [(); 2].map(|()| ResidualBlock::new(channels, channels, device));
        let (mut up, mut grow) = (Vec::new(), Vec::new());
        for level in (0..widths.len()).rev() {
            for _ in 0..2 {
                let skip = skips.pop().expect("two skips per level");
                up.push(step(channels + skip, level));
                channels = widths[level];
            }
            if level > 0 {
                grow.push(conv3x3(channels, channels, device));
            }
        }
        Self {
            enter: conv3x3(base, base, device),
            down,
            shrink,
            middle,
            up,
            grow,
            leave: conv3x3(channels, base, device),
            leave_norm: group_norm(base, 8, device),
        }
    }

    /// `[views, base, h, w]` to the same shape; `sources` `[views, 1 + neighbours]` lists for each view
    /// whose tokens it attends to, itself included.
    pub(crate) fn forward(&self, x: Tensor<4>, sources: &Tensor<2, Int>) -> Tensor<4> {
        let mut x = self.enter.forward(x);
        let mut skips = vec![x.clone()];
        for (level, step) in self.down.iter().enumerate() {
            x = step.forward(x, sources);
            skips.push(x.clone());
            if let Some(shrink) = self.shrink.get(level) {
                x = shrink.forward(x);
                skips.push(x.clone());
            }
        }
        x = self.middle.iter().fold(x, |x, block| block.forward(x));
        for (i, step) in self.up.iter().enumerate() {
            let skip = skips.pop().expect("two skips per level");
            x = step.forward(Tensor::cat(vec![x, skip], 1), sources);
            if let Some(grow) = self.grow.get(i / 2).filter(|_| i % 2 == 1) {
                x = grow.forward(nearest(x, 2));
            }
        }
        normed(&self.leave_norm, self.leave.forward(x), Activation::Silu, None)
    }
}
