//! Weights that read or write disparity in 1 / scene units, for a network whose disparity is relative.
//!
//! With `absolute = far + span * relative`, a convolution over the absolute disparity is one over the relative
//! disparity with its weights times `span` and `far` times their sum added to its bias; a correction is divided by
//! `span`. Exact for the range the weights were trained with, except at the image border, where padding with zeros
//! means another disparity.

use crate::checkpoint::tree::Named;
use crate::config::NetConfig;
use crate::cost_volume::DepthRange;
use std::collections::BTreeMap;

/// Converts the refinement's first and last convolution, where they were taken.
pub(super) fn convert(values: &mut BTreeMap<String, Vec<f32>>, ours: &[Named], config: &NetConfig, range: DepthRange) {
    let (far, span) = (range.far_disparity() as f32, range.disparity_span() as f32);
    let shape = |name: &str| ours.iter().find(|p| p.name == name).map(|p| p.shape.clone()).unwrap_or_default();
    // The inputs are the image, the projected features, the disparity, the confidence.
    let channel = 3 + config.refinement.unet.channels;
    let (weight, bias) = ("refinement.enter.weight", "refinement.enter.bias");
    if values.contains_key(weight)
        && values.contains_key(bias)
        && let [outputs, inputs, rows, columns] = shape(weight)[..]
    {
        let area = rows * columns;
        for output in 0..outputs {
            let at = (output * inputs + channel) * area;
            let kernel = &mut values.get_mut(weight).expect("checked above")[at..][..area];
            let sum: f32 = kernel.iter().sum();
            kernel.iter_mut().for_each(|w| *w *= span);
            values.get_mut(bias).expect("checked above")[output] += far * sum;
        }
    }
    // Output 0 is the correction, output 1 the density.
    for name in ["refinement.to_disparity.1.weight", "refinement.to_disparity.1.bias"] {
        let len = shape(name).iter().skip(1).product::<usize>();
        for value in values.get_mut(name).into_iter().flat_map(|values| &mut values[..len]) {
            *value /= span;
        }
    }
}
