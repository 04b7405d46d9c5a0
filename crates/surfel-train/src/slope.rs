//! How the depth map runs from pixel to pixel, against the truth: what orientations and meshes are made of.
//!
//! One term of the loss. An error of a tenth of a step hardly counts as depth, and roughens a surface that alternates
//! it. Invariant: an error that is the same everywhere costs nothing; an edge in a wrong place costs at most a step.

use crate::loss::mean;
use burn::tensor::Tensor;

/// Pixels between which differences are taken, along rows and columns.
const DISTANCES: [usize; 2] = [1, 3];
/// A true difference above this many steps per pixel is an edge, which no slope describes.
const EDGE_STEPS: f64 = 1.0;
/// Largest error of a difference that counts, steps.
const LARGEST_STEPS: f64 = 1.0;

/// Mean absolute error of the differences of inverse depth, steps. `predicted`, `truth` and the `counts` of pixels
/// (0 without truth) are `[views, height, width]`, inverse depths in steps.
pub(crate) fn slope(predicted: Tensor<3>, truth: Tensor<3>, counts: Tensor<3>) -> Tensor<1> {
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
    mean(Tensor::cat(errors, 0), Tensor::cat(weights, 0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::{Device, TensorData};

    fn map(value: impl Fn(usize, usize) -> f32) -> Tensor<3> {
        let values: Vec<f32> = (0..8 * 10).map(|i| value(i % 10, i / 10)).collect();
        Tensor::from_data(TensorData::new(values, [1, 8, 10]), &Device::flex())
    }

    fn cost(predicted: Tensor<3>, truth: Tensor<3>) -> f32 {
        slope(predicted, truth, map(|_, _| 1.0)).into_scalar()
    }

    #[test]
    fn a_shift_and_an_edge_cost_nothing_and_roughness_its_size() {
        let ramp = |x: usize, y: usize| 0.3 * x as f32 - 0.1 * y as f32;
        assert!(cost(map(|x, y| ramp(x, y) + 5.0), map(ramp)) < 1e-5);
        let edge = |at: usize| map(move |x, _| if x < at { 0.0 } else { 8.0 });
        // One pixel beside the edge jumps where the truth is flat: the clamp keeps that below a step each.
        assert!(cost(edge(5), edge(5)) < 1e-6);
        let rough = |x: usize, y: usize| ramp(x, y) + if (x + y).is_multiple_of(2) { 0.05 } else { -0.05 };
        assert!((cost(map(rough), map(ramp)) - 0.1).abs() < 1e-4);
    }

    #[test]
    fn pixels_that_do_not_count_say_nothing() {
        let truth = map(|x, _| 0.2 * x as f32);
        let predicted = map(|x, y| 0.2 * x as f32 + if y == 2 { 0.7 } else { 0.0 });
        let counts = map(|_, y| if y == 2 { 0.0 } else { 1.0 });
        assert!(slope(predicted, truth, counts).into_scalar::<f32>() < 1e-5);
    }
}
