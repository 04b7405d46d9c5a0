//! Maps made larger by an integer factor.
//!
//! Invariant: [`upsample`] keeps positions: pixel `i` of a map with stride `s` stays over input pixel `s i`.

use crate::ops::runs_on;
use burn::tensor::Tensor;
use burn::tensor::module::interpolate;
use burn::tensor::ops::{InterpolateMode, InterpolateOptions, PadMode};

/// Bilinear upsampling by an integer factor; `before` fine pixels lie before the first coarse one (0 where
/// coarse pixel `i` stands over fine pixel `factor i`), and the border is repeated.
pub(crate) fn upsample(map: Tensor<4>, factor: usize, before: usize) -> Tensor<4> {
    if factor == 1 {
        return map;
    }
    // On graphics cards burn cannot differentiate its bilinear interpolation.
    if !runs_on(&map.device()) {
        return along(along(map, 2, factor, before), 3, factor, before);
    }
    let [_, _, height, width] = map.dims();
    let size = [height, width].map(|n| factor * (n - 1) + 1);
    let options = InterpolateOptions::new(InterpolateMode::Bilinear).with_align_corners(true).with_output_size(size);
    let after = factor - 1 - before;
    interpolate(map, options).pad((before, after, before, after), PadMode::Edge)
}

/// The same along one axis, of operators that every device differentiates: means of neighbours, interleaved.
fn along(map: Tensor<4>, axis: usize, factor: usize, before: usize) -> Tensor<4> {
    let mut shape = map.dims();
    let last = shape[axis] - 1;
    let part = |start: usize, length: usize| map.clone().narrow(axis, start, length);
    let [previous, next] = match last {
        0 => [map.clone(), map.clone()],
        _ => {
            [vec![part(0, 1), part(0, last)], vec![part(1, last), part(last, 1)]].map(|parts| Tensor::cat(parts, axis))
        }
    };
    let phase = |fine: usize| {
        let share = (fine as f64 - before as f64) / factor as f64;
        let neighbour = if share < 0.0 { &previous } else { &next };
        map.clone() * (1.0 - share.abs()) + neighbour.clone() * share.abs()
    };
    shape[axis] *= factor;
    Tensor::stack::<5>((0..factor).map(phase).collect(), axis + 1).reshape(shape)
}

/// Nearest upsampling by an integer factor.
pub(crate) fn nearest(map: Tensor<4>, factor: usize) -> Tensor<4> {
    let [_, _, height, width] = map.dims();
    let size = [factor * height, factor * width];
    interpolate(map, InterpolateOptions::new(InterpolateMode::Nearest).with_output_size(size))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::values;
    use burn::tensor::{Device, TensorData};

    #[test]
    fn neighbours_interleaved_are_what_interpolation_gives_and_so_are_their_gradients() {
        let device = Device::flex().autodiff();
        let wave = |shape: [usize; 4]| {
            let values: Vec<f32> = (0..shape.iter().product()).map(|i| (i as f32 * 1.7).sin()).collect();
            Tensor::<4>::from_data(TensorData::new(values, shape), &device)
        };
        for (size, factor, before) in [([5, 7], 2, 0), ([5, 7], 2, 1), ([3, 4], 4, 0), ([4, 3], 4, 3), ([1, 3], 2, 0)] {
            let [height, width] = size;
            let map = wave([2, 3, height, width]).require_grad();
            let weights = wave([2, 3, factor * height, factor * width]);
            let answer = |large: Tensor<4>| {
                let gradients = (large.clone() * weights.clone()).sum().backward();
                [values(large), values(map.grad(&gradients).unwrap())]
            };
            let expected = answer(upsample(map.clone(), factor, before));
            let found = answer(along(along(map.clone(), 2, factor, before), 3, factor, before));
            for (expected, found) in expected.iter().flatten().zip(found.iter().flatten()) {
                assert!((expected - found).abs() < 1e-5, "{size:?} by {factor}: {found} instead of {expected}");
            }
        }
    }
}
