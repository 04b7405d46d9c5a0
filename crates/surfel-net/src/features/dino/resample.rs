//! Resampling of maps by matrices: each output row or column is a weighted sum of input ones.
//!
//! Invariant: the weights of an output sum to 1, and beyond the border the border is repeated.

use burn::tensor::{Tensor, TensorData};

/// Weights `[outputs, inputs]` along one side.
pub(super) struct Weights {
    values: Vec<f32>,
    inputs: usize,
}

impl Weights {
    fn new(outputs: impl Iterator<Item = Vec<(i64, f64)>>, inputs: usize) -> Self {
        let mut values = Vec::new();
        for taps in outputs {
            let mut row = vec![0.0f64; inputs];
            for (at, weight) in taps {
                row[at.clamp(0, inputs as i64 - 1) as usize] += weight;
            }
            values.extend(row.iter().map(|weight| *weight as f32));
        }
        Self { values, inputs }
    }

    fn num_outputs(&self) -> usize {
        self.values.len() / self.inputs
    }
}

/// Bilinear, at positions in index coordinates of the input.
pub(super) fn linear(positions: impl Iterator<Item = f64>, inputs: usize) -> Weights {
    let taps = |position: f64| {
        let (low, share) = (position.floor(), position - position.floor());
        vec![(low as i64, 1.0 - share), (low as i64 + 1, share)]
    };
    Weights::new(positions.map(taps), inputs)
}

/// Bicubic (`a` = -0.75), at positions in index coordinates of the input.
pub(super) fn cubic(positions: impl Iterator<Item = f64>, inputs: usize) -> Weights {
    const A: f64 = -0.75;
    let weight = |distance: f64| {
        let t = distance.abs();
        if t <= 1.0 {
            ((A + 2.0) * t - (A + 3.0)) * t * t + 1.0
        } else {
            ((A * t - 5.0 * A) * t + 8.0 * A) * t - 4.0 * A
        }
    };
    let taps = |position: f64| {
        let low = position.floor();
        (-1..=2).map(|step| (low as i64 + step, weight(position - low - step as f64))).collect()
    };
    Weights::new(positions.map(taps), inputs)
}

/// `[views, channels, height, width]` to the outputs of `rows` and `columns`.
pub(super) fn resampled(map: Tensor<4>, rows: &Weights, columns: &Weights) -> Tensor<4> {
    let device = map.device();
    let matrix = |weights: &Weights| {
        let shape = [1, 1, weights.num_outputs(), weights.inputs];
        Tensor::<4>::from_data(TensorData::new(weights.values.clone(), shape), &device)
    };
    let [views, channels, _, _] = map.dims();
    let spread = |matrix: Tensor<4>| {
        let [_, _, outputs, inputs] = matrix.dims();
        matrix.expand([views, channels, outputs, inputs])
    };
    spread(matrix(rows)).matmul(map).matmul(spread(matrix(columns)).swap_dims(2, 3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_sum_to_one_and_interpolate() {
        let positions = || (0..9).map(|i| 0.7 * f64::from(i) - 0.6);
        for weights in [linear(positions(), 6), cubic(positions(), 6)] {
            assert_eq!(weights.num_outputs(), 9);
            for row in weights.values.chunks_exact(6) {
                assert!((row.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            }
        }
        // Between the borders a line stays a line, beyond them the border is repeated.
        for (row, position) in linear(positions(), 6).values.chunks_exact(6).zip(positions()) {
            let found: f32 = row.iter().enumerate().map(|(at, weight)| at as f32 * weight).sum();
            assert!((f64::from(found) - position.clamp(0.0, 5.0)).abs() < 1e-5, "{found} vs {position}");
        }
        // At pixels their values are met, and half way the weights are those of a = -0.75.
        let weights = cubic([2.0, 2.5].into_iter(), 6).values;
        assert_eq!(weights[..6], [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        assert_eq!(weights[6..], [0.0, -0.09375, 0.59375, 0.59375, -0.09375, 0.0]);
    }
}
