//! Time of the trunk against the same layers built from burn's convolutions, in one run.
//!
//! `cargo bench -p surfel-net --bench features`

use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Distribution, Tensor};
use std::time::Instant;
use surfel_core::Grid;
use surfel_features::{FeatureExtractor, Stage};

/// Kernel, stride, inputs, outputs, groups of every convolution up to stride 4.
const LAYERS_S4: [(usize, usize, usize, usize, usize); 9] = [
    (3, 2, 3, 32, 1),
    (3, 1, 32, 32, 32),
    (1, 1, 32, 16, 1),
    (1, 1, 16, 96, 1),
    (3, 2, 96, 96, 96),
    (1, 1, 96, 24, 1),
    (1, 1, 24, 144, 1),
    (3, 1, 144, 144, 144),
    (1, 1, 144, 24, 1),
];

/// The best of many runs: what the code costs when the machine does nothing else.
fn best_ms(mut work: impl FnMut()) -> f64 {
    work();
    (0..25)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e3
        })
        .fold(f64::INFINITY, f64::min)
}

fn main() {
    let (width, height) = (320, 256);
    let image = Grid::from_fn(width, height, |x, y| [x as f32 / 320.0, y as f32 / 256.0, 0.5]);
    let extractor = FeatureExtractor::new().expect("the shipped weights load");
    let ours = |stages: &[Stage]| {
        best_ms(|| {
            std::hint::black_box(extractor.extract(&image, stages));
        })
    };
    let device = Device::flex();
    let random = |shape: [usize; 4]| Tensor::<4>::random(shape, Distribution::Uniform(-0.1, 0.1), &device);
    let weights: Vec<Tensor<4>> = LAYERS_S4.iter().map(|&(k, _, i, o, g)| random([o, i / g, k, k])).collect();
    let input = random([1, 3, height, width]);
    let burn_s4 = best_ms(|| {
        let mut x = input.clone();
        for (&(k, stride, _, _, groups), weight) in LAYERS_S4.iter().zip(&weights) {
            let options = ConvOptions::new([stride; 2], [k / 2; 2], [1; 2], groups);
            x = conv2d(x, weight.clone(), None, options).clamp(0.0, 6.0);
        }
        std::hint::black_box(x.into_data());
    });
    let s4 = ours(&[Stage::S4]);
    let all = ours(&[Stage::S4, Stage::S8, Stage::S16]);
    println!("{width}x{height}: stride 4 {s4:.1} ms, all stages {all:.1} ms");
    println!("burn's convolutions, same layers up to stride 4: {burn_s4:.1} ms, {:.1} times ours", burn_s4 / s4);
}
