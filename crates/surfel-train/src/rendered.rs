//! The terms that look at what the surfels show to the cameras of the sample (paper: `L`; spec 4.3).
//!
//! Between the network's surfels and `surfel-loss`, which knows the terms. Invariant: every view of a sample counts
//! the same, and nothing is rendered unless a term has a weight.

use crate::error::TrainError;
use crate::sample::Sample;
use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};
use surfel_loss::{Perceptual, Recipe, Truth, view_terms};
use surfel_net::{SurfelTensors, render};

/// Weights of the terms on rendered maps; all 0 unless given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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
    /// Alpha against the pixels that show a surface.
    pub silhouette: f64,
    /// Which depth the alignment looks at: 0 the expected one, which is smoother, 1 the median.
    pub depth_ratio: f64,
}

impl RenderedWeights {
    /// Whether anything has to be rendered.
    pub fn is_some(&self) -> bool {
        let Self { photometric, perceptual, alignment, depth, normal, silhouette, depth_ratio: _ } = *self;
        [photometric, perceptual, alignment, depth, normal, silhouette].iter().any(|weight| *weight != 0.0)
    }

    fn recipe(&self) -> Recipe {
        Recipe {
            photometric: self.photometric,
            perceptual: self.perceptual,
            alignment: self.alignment,
            rendered_depth: self.depth,
            normal: self.normal,
            silhouette: self.silhouette,
            depth_ratio: self.depth_ratio,
        }
    }
}

/// The terms with a weight: name, weight, mean over the views.
///
/// # Errors
/// When the surfels cannot be rendered or the views are too small for SSIM.
pub(crate) fn terms(
    surfels: &SurfelTensors,
    sample: &Sample,
    weights: &RenderedWeights,
    perceptual: &Perceptual,
    device: &Device,
) -> Result<Vec<(&'static str, f64, Tensor<1>)>, TrainError> {
    let mut sums: Vec<(&'static str, f64, Tensor<1>)> = Vec::new();
    if !weights.is_some() {
        return Ok(sums);
    }
    let share = 1.0 / sample.num_views() as f64;
    for view in 0..sample.num_views() {
        let (camera, range) = (&sample.cameras[view], &sample.ranges[view]);
        let maps = render(surfels, camera, &range.render_config())?;
        let truth = truth(sample, view, device);
        let context = (&camera.intrinsics, range);
        let terms = view_terms(&maps, &truth, context, perceptual, &weights.recipe())?;
        for term in terms.list {
            let value = term.value * share;
            match sums.iter_mut().find(|(name, ..)| *name == logged_as(term.name)) {
                Some((_, _, sum)) => *sum = sum.clone() + value,
                None => sums.push((logged_as(term.name), term.weight, value)),
            }
        }
    }
    Ok(sums)
}

/// Names in logs tell these terms from those of the encoder's maps.
fn logged_as(name: &'static str) -> &'static str {
    match name {
        "normal" => "rendered_normal",
        "rendered depth" => "rendered_depth",
        "1 - SSIM" => "ssim",
        "LPIPS" => "lpips",
        other => other,
    }
}

fn truth(sample: &Sample, view: usize, device: &Device) -> Truth {
    let (width, height) = sample.size();
    let map = |values: Vec<f32>| -> Tensor<2> { Tensor::from_data(TensorData::new(values, [height, width]), device) };
    let vectors = |values: &[[f32; 3]]| -> Tensor<3> {
        let values = values.as_flattened().to_vec();
        Tensor::<3>::from_data(TensorData::new(values, [height, width, 3]), device).permute([2, 0, 1])
    };
    let (depth, normal) = (sample.depth[view].as_slice(), sample.normal[view].as_slice());
    let flag = |is: bool| if is { 1.0 } else { 0.0 };
    Truth {
        photograph: vectors(sample.images[view].as_slice()),
        depth: Some(map(depth.to_vec())),
        normals: Some((vectors(normal), map(normal.iter().map(|n| flag(*n != [0.0; 3])).collect()))),
        mask: Some(map(depth.iter().map(|z| flag(*z > 0.0)).collect())),
    }
}
