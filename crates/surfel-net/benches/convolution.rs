//! Time of our convolution against burn's own, at the sizes of the small network on a pair of 256 x 320.
//!
//! `cargo bench -p surfel-net --bench convolution`; `RAYON_NUM_THREADS=1` in front for one thread.

use burn::tensor::module::conv2d as burn_conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Distribution, Tensor};
use std::time::Instant;
use surfel_net::ops::conv2d;

/// Kernel, stride, inputs, outputs, input rows and columns.
const SIZES: [(usize, usize, usize, usize, usize, usize); 10] = [
    (3, 1, 71, 24, 128, 160),
    (3, 1, 24, 24, 128, 160),
    (3, 1, 48, 24, 128, 160),
    (1, 1, 48, 24, 128, 160),
    (3, 2, 24, 24, 128, 160),
    (3, 1, 48, 48, 64, 80),
    (3, 1, 96, 48, 64, 80),
    (3, 1, 96, 96, 16, 20),
    (3, 1, 47, 18, 256, 320),
    (7, 2, 3, 64, 256, 320),
];

const VIEWS: usize = 2;

/// The best of several runs of both, taken in turns so that a busy machine treats them alike.
fn best_ms(mut first: impl FnMut(), mut second: impl FnMut()) -> [f64; 2] {
    let mut best = [f64::INFINITY; 2];
    for _ in 0..8 {
        let works: [&mut dyn FnMut(); 2] = [&mut first, &mut second];
        for (best, work) in best.iter_mut().zip(works) {
            let start = Instant::now();
            work();
            *best = best.min(start.elapsed().as_secs_f64() * 1e3);
        }
    }
    best
}

fn main() {
    println!("two views, milliseconds; GFLOP/s of ours");
    println!(
        "kernel  channels   rows x columns | forward: ours  burn  ratio GFLOP/s | with backward: ours  burn  ratio"
    );
    let mut totals = [[0.0; 2]; 2];
    for (kernel, stride, inputs, outputs, height, width) in SIZES {
        let run = |device: &Device, ours: bool, backward: bool| {
            let random = |shape: [usize; 4]| Tensor::<4>::random(shape, Distribution::Uniform(-1.0, 1.0), device);
            let x = random([VIEWS, inputs, height, width]);
            let weight = random([outputs, inputs, kernel, kernel]);
            let bias = Tensor::<1>::zeros([outputs], device);
            let options = ConvOptions::new([stride; 2], [kernel / 2; 2], [1; 2], 1);
            move || {
                let (x, weight, bias) = if backward {
                    (x.clone().require_grad(), weight.clone().require_grad(), bias.clone().require_grad())
                } else {
                    (x.clone(), weight.clone(), bias.clone())
                };
                let y = if ours {
                    conv2d(x.clone(), weight, Some(bias), stride, kernel / 2)
                } else {
                    burn_conv2d(x.clone(), weight, Some(bias), options.clone())
                };
                if backward {
                    std::hint::black_box(x.grad(&y.sum().backward()));
                } else {
                    std::hint::black_box(y);
                }
            }
        };
        let plain = Device::flex();
        let forward = best_ms(run(&plain, true, false), run(&plain, false, false));
        let tracked = Device::flex().autodiff();
        let both = best_ms(run(&tracked, true, true), run(&tracked, false, true));
        let flop = 2 * VIEWS * inputs * outputs * kernel * kernel * (height / stride) * (width / stride);
        let rate = flop as f64 / forward[0] / 1e6;
        println!(
            "{kernel} x {kernel} / {stride} {inputs:3} -> {outputs:2} {height:4} x {width:3} | {:6.2} {:7.2} {:5.1} {rate:5.0} | {:6.2} {:7.2} {:5.1}",
            forward[0],
            forward[1],
            forward[1] / forward[0],
            both[0],
            both[1],
            both[1] / both[0],
        );
        for (totals, times) in totals.iter_mut().zip([forward, both]) {
            totals.iter_mut().zip(times).for_each(|(total, time)| *total += time);
        }
    }
    for (what, [ours, burn]) in ["forward", "forward and backward"].iter().zip(totals) {
        println!("all of them, {what}: ours {ours:.1} ms, burn's {burn:.1} ms, {:.1} times ours", burn / ours);
    }
}
