//! How much each term of the loss weighs: the tables `[loss]` and `[loss.rendered]` of a configuration.
//!
//! Invariant: a weight of 0 switches its term off; it is not even computed.

use serde::{Deserialize, Serialize};

/// Weights of the terms; those of terms that only some networks or stages use are 0 unless given.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossWeights {
    /// `L_d` in steps: [`surfel_loss::depth_in_steps`].
    pub depth: f64,
    /// `L_d` as the paper has it, in units of the depth range: [`surfel_loss::depth`].
    #[serde(default)]
    pub range_depth: f64,
    /// `L_n`: orientation of the final surfels, [`surfel_loss::chord`].
    pub normal: f64,
    /// The same of the initial surfels.
    pub initial_normal: f64,
    /// The same of the planes under the surfels, before the head's say.
    #[serde(default)]
    pub plane_normal: f64,
    /// How the depth map runs from pixel to pixel: [`surfel_loss::slope`].
    #[serde(default)]
    pub slope: f64,
    /// Belief in the planes that are proposed to each block: [`surfel_loss::choice`].
    #[serde(default)]
    pub choice: f64,
    /// Opacity as the probability that the depth is right: [`surfel_loss::calibrated_opacity`].
    pub opacity: f64,
    /// Opacities of the final surfels near 0 or 1: [`surfel_loss::opacity`].
    #[serde(default)]
    pub decided_opacity: f64,
    /// How much more a pixel of an object counts in depth, slope and choice than one of its surroundings.
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
    /// The weights at a step of the run.
    pub fn at(&self, step: u64) -> Self {
        Self { rendered: self.rendered.at(step), ..*self }
    }

    /// Whether a term looks at the surfels, or only at the encoder's maps.
    pub fn needs_surfels(&self) -> bool {
        [self.normal, self.initial_normal, self.decided_opacity].iter().any(|weight| *weight != 0.0)
            || self.rendered.is_some()
    }
}

/// Weights of the terms on rendered maps; all 0 unless given.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RenderedWeights {
    /// Squared difference of colours.
    pub photometric: f64,
    /// LPIPS where its weights are given, else `1 - SSIM`.
    pub perceptual: f64,
    /// Surfels against the normals of their depth.
    pub alignment: f64,
    /// Median depth.
    pub depth: f64,
    /// Blended normals.
    pub normal: f64,
    /// Alpha against the pixels that show a surface; only where it is known which show none.
    pub silhouette: f64,
    /// Which depth the alignment looks at: 0 the expected one, which is smoother, 1 the median.
    pub depth_ratio: f64,
    /// First step with alignment: before surfels are near the surface it only flattens them.
    pub align_from: u64,
    /// How much a view given to the network counts where a view held out counts 1; among themselves all count the same.
    pub context: f64,
}

impl Default for RenderedWeights {
    fn default() -> Self {
        Self {
            photometric: 0.0,
            perceptual: 0.0,
            alignment: 0.0,
            depth: 0.0,
            normal: 0.0,
            silhouette: 0.0,
            depth_ratio: 0.0,
            align_from: 0,
            context: 1.0,
        }
    }
}

impl RenderedWeights {
    /// Whether anything has to be rendered.
    pub fn is_some(&self) -> bool {
        let Self { photometric, perceptual, alignment, depth, normal, silhouette, .. } = *self;
        [photometric, perceptual, alignment, depth, normal, silhouette].iter().any(|weight| *weight != 0.0)
    }

    /// The weights at a step of the run.
    pub(crate) fn at(&self, step: u64) -> Self {
        Self { alignment: if step < self.align_from { 0.0 } else { self.alignment }, ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alignment_begins_at_its_step() {
        let weights = RenderedWeights { alignment: 0.5, align_from: 3, ..RenderedWeights::default() };
        assert_eq!([0, 2, 3, 9].map(|step| weights.at(step).alignment), [0.0, 0.0, 0.5, 0.5]);
    }
}
