//! The terms that look at what the surfels show to the cameras of the sample (paper: `L`; spec 4.3).
//!
//! Between the network's surfels and `surfel-loss`, which knows the terms. Invariant: in each term every view that can
//! tell it counts the same, and nothing is rendered unless a term has a weight and its truth.

use crate::error::TrainError;
use crate::sample::Sample;
use crate::truth::{Hole, ViewTruth};
use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};
use surfel_core::Grid;
use surfel_loss::{Perceptual, Recipe, Term, Truth, view_terms};
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
    /// Alpha against the pixels that show a surface; only where it is known which show none.
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

/// The terms with a weight and a truth: name, weight, mean over the views that have the truth.
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
    let recipe = weights.recipe();
    let mut of_views: Vec<Term> = Vec::new();
    for view in 0..sample.num_views() {
        let truth = known(&sample.images[view], &sample.truth[view], device);
        if !recipe.can_tell(&truth) {
            continue;
        }
        let (camera, range) = (&sample.cameras[view], &sample.ranges[view]);
        let maps = render(surfels, camera, &range.render_config())?;
        of_views.extend(view_terms(&maps, &truth, (&camera.intrinsics, range), perceptual, &recipe)?.list);
    }
    Ok(means(of_views))
}

/// One term of each name, in the order of their first appearance.
fn means(of_views: Vec<Term>) -> Vec<(&'static str, f64, Tensor<1>)> {
    let mut counts: Vec<(&'static str, usize)> = Vec::new();
    for term in &of_views {
        match counts.iter_mut().find(|(name, _)| *name == term.name) {
            Some((_, count)) => *count += 1,
            None => counts.push((term.name, 1)),
        }
    }
    let mean = |&(name, count): &(&'static str, usize)| {
        let share = 1.0 / count as f64;
        let mut terms = of_views.iter().filter(|term| term.name == name);
        let first = terms.next()?;
        let sum = terms.fold(first.value.clone() * share, |sum, term| sum + term.value.clone() * share);
        Some((logged_as(name), first.weight, sum))
    };
    counts.iter().filter_map(mean).collect()
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

/// What the terms are told of a view.
fn known(photograph: &Grid<[f32; 3]>, truth: &ViewTruth, device: &Device) -> Truth {
    let (width, height) = (photograph.width(), photograph.height());
    let map = |values: Vec<f32>| -> Tensor<2> { Tensor::from_data(TensorData::new(values, [height, width]), device) };
    let vectors = |grid: &Grid<[f32; 3]>| -> Tensor<3> {
        let values = grid.as_slice().as_flattened().to_vec();
        Tensor::<3>::from_data(TensorData::new(values, [height, width, 3]), device).permute([2, 0, 1])
    };
    let flag = |is: bool| if is { 1.0 } else { 0.0 };
    let has_normal = |grid: &Grid<[f32; 3]>| grid.as_slice().iter().map(|n| flag(*n != [0.0; 3])).collect();
    // A depth map with holes does not say where the surface ends.
    let whole = truth.depth.as_ref().filter(|depth| depth.hole == Hole::Empty);
    Truth {
        photograph: vectors(photograph),
        depth: truth.depth.as_ref().map(|depth| map(depth.map.as_slice().to_vec())),
        normals: truth.normal.as_ref().map(|normal| (vectors(normal), map(has_normal(normal)))),
        mask: whole.map(|depth| map(depth.map.as_slice().iter().map(|z| flag(*z > 0.0)).collect())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::tests::analytic;

    #[test]
    fn a_measurement_with_holes_says_nothing_of_the_silhouette() {
        let sample = analytic(3);
        let known = |truth: &ViewTruth| known(&sample.images[0], truth, &Device::flex());
        let mut truth = sample.truth[0].clone();
        assert!(known(&truth).mask.is_some());
        truth.depth.as_mut().unwrap().hole = Hole::Unmeasured;
        assert!(known(&truth).mask.is_none() && known(&truth).depth.is_some() && known(&truth).normals.is_some());
        let nothing = known(&ViewTruth::default());
        assert!(nothing.depth.is_none() && nothing.normals.is_none());
    }
}
