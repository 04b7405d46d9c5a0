//! How the depth map runs from pixel to pixel, against the truth: what orientations and meshes are made of.
//!
//! An error of a tenth of a step hardly counts as depth, and roughens a surface that alternates it. Invariant: an error
//! that is the same everywhere costs nothing; an edge in a wrong place costs at most a step.

use crate::mean::weighted_mean;
use burn::tensor::Tensor;

/// Pixels between which differences are taken, along rows and columns.
const DISTANCES: [usize; 2] = [1, 3];
/// A true difference above this many steps per pixel is an edge, which no slope describes.
const EDGE_STEPS: f64 = 1.0;
/// Largest error of a difference that counts, steps.
const LARGEST_STEPS: f64 = 1.0;

/// Mean absolute error of the differences of inverse depth, steps. `predicted`, `truth` and the `counts` of pixels
/// (0 without truth) are `[views, height, width]`, inverse depths in steps.
///
/// # Panics
/// If the maps differ in size (a programmer's error).
pub fn slope(predicted: Tensor<3>, truth: Tensor<3>, counts: Tensor<3>) -> Tensor<1> {
    let dims = predicted.dims();
    let mut errors = Vec::new();
    let mut weights = Vec::new();
    for distance in DISTANCES {
        for axis in [1, 2] {
            let Some(len) = dims[axis].checked_sub(distance).filter(|len| *len > 0) else { continue };
            let pair = |map: &Tensor<3>| [0, distance].map(|start| map.clone().narrow(axis, start, len));
            let difference = |map: &Tensor<3>| {
                let [from, to] = pair(map);
                to - from
            };
            let expected = difference(&truth);
            let smooth = expected.clone().abs().lower_elem(EDGE_STEPS * distance as f64).float();
            let [from, to] = pair(&counts);
            errors.push((difference(&predicted) - expected).abs().clamp_max(LARGEST_STEPS).flatten(0, 2));
            weights.push((from * to * smooth).flatten(0, 2));
        }
    }
    weighted_mean(Tensor::cat(errors, 0), Tensor::cat(weights, 0))
}
