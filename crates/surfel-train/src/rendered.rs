//! The terms that look at what the surfels show to cameras, those of views held out first of all (paper: `L`; spec 4.3).
//!
//! Between the network's surfels and `surfel-loss`, which knows the terms. Invariant: in each term every view held out
//! that can tell it counts the same, every view given `context` times as much, and nothing is rendered unless a term has
//! a weight and its truth.

use crate::error::TrainError;
use crate::loss_weights::RenderedWeights;
use crate::sample::{Sample, Target};
use crate::truth::{Hole, ViewTruth};
use burn::tensor::{Device, Tensor, TensorData};
use surfel_core::{Camera, Grid};
use surfel_loss::{Perceptual, Recipe, Term, Truth, view_terms};
use surfel_net::{DepthRange, SurfelTensors, render};

/// The weights as `surfel-loss` takes them.
fn recipe(weights: &RenderedWeights) -> Recipe {
    Recipe {
        photometric: weights.photometric,
        perceptual: weights.perceptual,
        alignment: weights.alignment,
        rendered_depth: weights.depth,
        normal: weights.normal,
        silhouette: weights.silhouette,
        depth_ratio: weights.depth_ratio,
    }
}

/// A view to render, and how much it counts.
struct Seen<'a> {
    image: &'a Grid<[f32; 3]>,
    camera: &'a Camera,
    range: &'a DepthRange,
    truth: &'a ViewTruth,
    counts: f64,
}

/// The views of a sample that count: those given, then those held out.
fn seen<'a>(sample: &'a Sample, context: f64) -> impl Iterator<Item = Seen<'a>> {
    let given = (0..sample.num_views()).map(move |v| Seen {
        image: &sample.images[v],
        camera: &sample.cameras[v],
        range: &sample.ranges[v],
        truth: &sample.truth[v],
        counts: context,
    });
    let held_out = sample.targets.iter().map(|target| {
        let Target { image, camera, range, truth } = target;
        Seen { image, camera, range, truth, counts: 1.0 }
    });
    given.chain(held_out).filter(|view| view.counts > 0.0)
}

/// The terms with a weight and a truth, each the mean over the views that have the truth.
///
/// # Errors
/// When the surfels cannot be rendered or the views are too small for SSIM.
pub(crate) fn terms(
    surfels: &SurfelTensors,
    sample: &Sample,
    weights: &RenderedWeights,
    perceptual: &Perceptual,
    device: &Device,
) -> Result<Vec<Term>, TrainError> {
    let recipe = recipe(weights);
    let mut of_views: Vec<(Term, f64)> = Vec::new();
    for Seen { image, camera, range, truth, counts } in seen(sample, weights.context) {
        let truth = known(image, truth, device);
        if !recipe.can_tell(&truth) {
            continue;
        }
        let maps = render(surfels, camera, &range.render_config())?;
        let terms = view_terms(&maps, &truth, (&camera.intrinsics, range), perceptual, &recipe)?;
        of_views.extend(terms.list.into_iter().map(|term| (term, counts)));
    }
    Ok(means(of_views))
}

/// One term of each name, in the order of their first appearance.
fn means(of_views: Vec<(Term, f64)>) -> Vec<Term> {
    let mut totals: Vec<(&'static str, f64)> = Vec::new();
    for (term, counts) in &of_views {
        match totals.iter_mut().find(|(name, _)| *name == term.name) {
            Some((_, total)) => *total += counts,
            None => totals.push((term.name, *counts)),
        }
    }
    let mean = |&(name, total): &(&'static str, f64)| {
        let of_name = of_views.iter().filter(|(term, _)| term.name == name);
        let shares = of_name.clone().map(|(term, counts)| term.value.clone() * (counts / total));
        let weight = of_name.map(|(term, _)| term.weight).next()?;
        Some(Term { name: logged_as(name), weight, value: shares.reduce(|sum, share| sum + share)? })
    };
    totals.iter().filter_map(mean).collect()
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
pub(crate) mod tests {
    use super::*;
    use crate::source::tests::{analytic, with_targets};
    use glam::DQuat;

    /// A grey surfel that faces the first view at every pixel of its true depth.
    pub(crate) fn grey(sample: &Sample, device: &Device) -> SurfelTensors {
        let camera = &sample.cameras[0];
        let place = |i: usize| {
            let pixel = Camera::pixel_centre(i % camera.width, i / camera.width);
            camera.unproject(pixel, f64::from(sample.truth[0].depth_at(i))).as_vec3().to_array()
        };
        let seen = (0..sample.num_pixels()).filter(|i| sample.truth[0].depth_at(*i) > 0.0);
        let centres: Vec<f32> = seen.flat_map(place).collect();
        let count = centres.len() / 3;
        let world_from_camera = DQuat::from_mat3(&camera.camera_from_world.rotation.transpose());
        let rotation = [world_from_camera.w, world_from_camera.x, world_from_camera.y, world_from_camera.z];
        let rotation = Tensor::<1>::from_floats(rotation.map(|v| v as f32), device).unsqueeze_dim::<2>(0);
        SurfelTensors {
            centres: Tensor::from_data(TensorData::new(centres, [count, 3]), device),
            scales: Tensor::ones([count, 2], device) * 5.0,
            rotations: rotation.repeat_dim(0, count),
            opacities: Tensor::ones([count], device) * 0.9,
            sh: Tensor::zeros([count, 1, 3], device),
            sh_degree: 0,
        }
    }

    #[test]
    fn views_held_out_count_beside_views_given() {
        let device = Device::flex();
        let sample = with_targets(3, 1);
        let surfels = grey(&sample, &device);
        let photometric = |sample: &Sample, context: f64| {
            let weights = RenderedWeights { photometric: 1.0, context, ..RenderedWeights::default() };
            let terms = terms(&surfels, sample, &weights, &Perceptual::Ssim, &device).unwrap();
            terms.into_iter().map(|term| f64::from(term.value.into_scalar::<f32>())).next()
        };
        let given = Sample { targets: Vec::new(), ..sample.clone() };
        assert_eq!(photometric(&given, 0.0), None);
        assert_eq!(photometric(&given, 0.3), photometric(&given, 1.0));
        let (of_given, held_out) = (photometric(&given, 1.0).unwrap(), photometric(&sample, 0.0).unwrap());
        assert!((of_given - held_out).abs() > 1e-4, "the test cannot tell one view from the other");
        let expected = (2.0 * 0.5 * of_given + held_out) / (2.0 * 0.5 + 1.0);
        assert!((photometric(&sample, 0.5).unwrap() - expected).abs() < 1e-6);
    }

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
