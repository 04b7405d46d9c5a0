//! The fused gather attention against explicit softmax in f64, its gradient against finite differences, and through burn.

use burn::tensor::{Device, Tensor, TensorData, Tolerance};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use std::sync::Arc;
use surfel_net::ops::gather_attention::{Inputs, Regions, Window, backward, forward};

const WIDTH: usize = 6;
const HEIGHT: usize = 5;
const VIEWS: usize = 3;
const CHANNELS: usize = 20;
const HEADS: usize = 2;
const SURFELS: usize = VIEWS * WIDTH * HEIGHT;

/// Each home view looks into itself and one other; windows are random, some step over pixels, one surfel has none.
fn regions() -> Regions {
    let mut rng = StdRng::seed_from_u64(9);
    let side = 5;
    let mut windows = Vec::new();
    for surfel in 0..SURFELS {
        for _ in 0..2 {
            let step = rng.random_range(1..3);
            let (x, y) = (rng.random_range(-4..4), rng.random_range(-4..4));
            let mut mask = 0u64;
            for bit in 0..(side * side) as i32 {
                let (px, py) = (x + bit % 5 * step, y + bit / 5 * step);
                let inside = px >= 0 && py >= 0 && px < WIDTH as i32 && py < HEIGHT as i32;
                if inside && rng.random_bool(0.6) && surfel != 17 {
                    mask |= 1 << bit;
                }
            }
            windows.push(Window { x, y, step, mask });
        }
    }
    Regions { width: WIDTH, height: HEIGHT, side, targets: vec![vec![0, 2], vec![1, 0], vec![2, 1]], windows }
}

fn random(seed: u64) -> Vec<f32> {
    let mut rng = StdRng::seed_from_u64(seed);
    (0..SURFELS * CHANNELS).map(|_| rng.random_range(-2.0..2.0)).collect()
}

/// Spec 2.7.4 with every score in a list.
fn twin(query: &[f64], key: &[f64], value: &[f64], regions: &Regions) -> Vec<f64> {
    let dim = CHANNELS / HEADS;
    let mut output = vec![0.0; SURFELS * CHANNELS];
    for surfel in 0..SURFELS {
        let mut pixels = Vec::new();
        regions.pixels(surfel, &mut pixels);
        for head in 0..HEADS {
            let row = |values: &[f64], i: usize| values[i * CHANNELS + head * dim..][..dim].to_vec();
            let exponentials: Vec<f64> = pixels
                .iter()
                .map(|&p| row(query, surfel).iter().zip(row(key, p)).map(|(q, k)| q * k).sum::<f64>())
                .map(|score| (score / (dim as f64).sqrt()).exp())
                .collect();
            let sum: f64 = exponentials.iter().sum();
            for (&pixel, e) in pixels.iter().zip(&exponentials) {
                for (c, v) in row(value, pixel).iter().enumerate() {
                    output[surfel * CHANNELS + head * dim + c] += e / sum * v;
                }
            }
        }
    }
    output
}

fn in_f64(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&v| f64::from(v)).collect()
}

#[test]
fn equals_the_explicit_softmax() {
    let regions = regions();
    let (query, key, value) = (random(1), random(2), random(3));
    let inputs = Inputs { query: &query, key: &key, value: &value, channels: CHANNELS, num_heads: HEADS };
    let (fast, plain) = (forward(&inputs, &regions), twin(&in_f64(&query), &in_f64(&key), &in_f64(&value), &regions));
    for (i, (a, b)) in fast.iter().zip(&plain).enumerate() {
        assert!((f64::from(*a) - b).abs() < 1e-4, "{i}: {a} vs {b}");
    }
    assert!(fast[17 * CHANNELS..18 * CHANNELS].iter().all(|v| *v == 0.0));
}

#[test]
fn gradients_equal_finite_differences() {
    let regions = regions();
    let (query, key, value, grad) = (random(4), random(5), random(6), random(7));
    let inputs = Inputs { query: &query, key: &key, value: &value, channels: CHANNELS, num_heads: HEADS };
    let analytic = backward(&inputs, &regions, &grad);
    let mut at = [in_f64(&query), in_f64(&key), in_f64(&value)];
    let loss = |at: &[Vec<f64>; 3]| {
        twin(&at[0], &at[1], &at[2], &regions).iter().zip(&grad).map(|(o, g)| o * f64::from(*g)).sum::<f64>()
    };
    for (which, analytic) in [analytic.query, analytic.key, analytic.value].iter().enumerate() {
        for i in (which..SURFELS * CHANNELS).step_by(29) {
            let (step, centre) = (1e-4, at[which][i]);
            at[which][i] = centre + step;
            let up = loss(&at);
            at[which][i] = centre - step;
            let numeric = (up - loss(&at)) / (2.0 * step);
            at[which][i] = centre;
            assert!((f64::from(analytic[i]) - numeric).abs() < 2e-3, "{which} {i}: {} vs {numeric}", analytic[i]);
        }
    }
}

#[test]
fn burn_differentiates_through_it() {
    let device = Device::flex().autodiff();
    let regions = regions();
    let (query, key, value, grad) = (random(8), random(9), random(10), random(11));
    let tensor = |v: &[f32]| Tensor::<2>::from_data(TensorData::new(v.to_vec(), [SURFELS, CHANNELS]), &device);
    let [q, k, v] = [&query, &key, &value].map(|v| tensor(v).require_grad());
    let shared = Arc::new(regions.clone());
    let output = surfel_net::ops::gather_attention(q.clone(), k.clone(), v.clone(), HEADS, shared);
    let grads = (output * tensor(&grad)).sum().backward();
    let inputs = Inputs { query: &query, key: &key, value: &value, channels: CHANNELS, num_heads: HEADS };
    let direct = backward(&inputs, &regions, &grad);
    for (leaf, direct) in [(q, direct.query), (k, direct.key), (v, direct.value)] {
        let expected = TensorData::new(direct, [SURFELS, CHANNELS]);
        leaf.grad(&grads).unwrap().into_data().assert_approx_eq::<f32>(&expected, Tolerance::absolute(1e-5));
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let regions = regions();
    let (query, key, value, grad) = (random(12), random(13), random(14), random(15));
    let inputs = Inputs { query: &query, key: &key, value: &value, channels: CHANNELS, num_heads: HEADS };
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let grads = pool.install(|| backward(&inputs, &regions, &grad));
        (pool.install(|| forward(&inputs, &regions)), grads.query, grads.key, grads.value)
    };
    assert!(run(1) == run(4));
}
