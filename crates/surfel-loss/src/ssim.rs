//! Structural similarity, differentiable: the perceptual term where no LPIPS weights are given (spec 4.3, 7.4).
//!
//! Gaussian window of sigma 1.5 over 11 x 11 pixels, sample covariance, K1 = 0.01, K2 = 0.03, range 1, the 5 border
//! pixels left out, mean over channels. Invariant: the same number as the metric of `surfel-eval`.

use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Tensor, TensorData};

/// Pixels along one side of the window; smaller pictures have no SSIM.
pub(crate) const SIDE: usize = 11;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;
/// `NP / (NP - 1)` for the 121 pixels of the window: sample instead of population covariance.
const SAMPLE: f64 = (SIDE * SIDE) as f64 / (SIDE * SIDE - 1) as f64;

/// Mean SSIM, at most 1, of two pictures `[3, height, width]`, sRGB in \[0, 1\].
///
/// # Panics
/// If the pictures differ in size or a side is below 11 pixels (a programmer's error: see
/// [`crate::Perceptual::distance`] for the checked way).
pub fn ssim(picture: Tensor<3>, reference: Tensor<3>) -> Tensor<1> {
    let (p, q) = (picture, reference);
    let moments = vec![p.clone(), q.clone(), p.clone().square(), q.clone().square(), p * q];
    let means = filtered(Tensor::cat(moments, 0));
    let moment = |index: usize| means.clone().narrow(0, 3 * index, 3);
    let (p, q) = (moment(0), moment(1));
    let (pp, qq, pq) = (p.clone().square(), q.clone().square(), p * q);
    let variances = (moment(2) - pp.clone() + moment(3) - qq.clone()) * SAMPLE;
    let covariance = (moment(4) - pq.clone()) * SAMPLE;
    let similar = (pq * 2.0 + C1) * (covariance * 2.0 + C2);
    (similar / ((pp + qq + C1) * (variances + C2))).mean()
}

/// Weighted means over every whole window, one direction after the other.
fn filtered(maps: Tensor<3>) -> Tensor<3> {
    let window = |shape: [usize; 4]| -> Tensor<4> {
        Tensor::from_data(TensorData::new(window().to_vec(), shape), &maps.device())
    };
    let pass =
        |maps: Tensor<4>, weights: Tensor<4>| conv2d(maps, weights, None, ConvOptions::new([1, 1], [0, 0], [1, 1], 1));
    let rows = pass(maps.clone().unsqueeze_dim(1), window([1, 1, SIDE, 1]));
    pass(rows, window([1, 1, 1, SIDE])).squeeze_dim(1)
}

/// The normalised 1-D Gaussian.
fn window() -> [f32; SIDE] {
    let raw: [f64; SIDE] = std::array::from_fn(|i| {
        let d = i as f64 - (SIDE / 2) as f64;
        (-d * d / (2.0 * SIGMA * SIGMA)).exp()
    });
    let sum: f64 = raw.iter().sum();
    raw.map(|w| (w / sum) as f32)
}
