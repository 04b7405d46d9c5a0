//! The fused plane sweep against a plain one in f64, its gradient against finite differences, and through burn.

use burn::tensor::{Device, Tensor, TensorData};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use std::sync::Arc;
use surfel_net::ops::plane_sweep::{Base, Sweep, Warp, backward, forward};

const CHANNELS: usize = 11;
const WIDTH: usize = 7;
const HEIGHT: usize = 5;

/// Three views whose warps shift, turn, leave the map, and (the last) pass behind the neighbour.
fn geometry(base: Base) -> Sweep {
    let warp = |other, shift: f32, tilt: f32| Warp {
        other,
        rotation: [[1.0, 0.1 * tilt, 0.3], [-0.1 * tilt, 0.97, 0.2], [0.01, -0.02 * tilt, 1.0]],
        translation: [shift, 0.4 * shift, 0.05],
    };
    let mut behind = warp(0, 1.0, 0.3);
    behind.translation[2] = -2.0;
    Sweep {
        width: WIDTH,
        height: HEIGHT,
        warps: vec![
            vec![warp(1, 2.0, 1.0), warp(2, -3.0, -1.0)],
            vec![warp(0, -2.2, 0.5), warp(2, 9.0, 0.0)],
            vec![behind, warp(1, 0.35, 0.0)],
        ],
        disparities: (0..3).map(|v| (0..6).map(|j| 0.05 + 0.17 * (j + v) as f32).collect()).collect(),
        base,
    }
}

fn per_pixel() -> Base {
    Base::PerPixel((0..3 * WIDTH * HEIGHT).map(|i| 0.02 * (i % 9) as f32).collect())
}

fn per_candidate() -> Base {
    Base::PerCandidate((0..3 * 6 * WIDTH * HEIGHT).map(|i| 0.03 * (i % 7) as f32).collect())
}

fn random(len: usize, seed: u64) -> Vec<f32> {
    let mut rng = StdRng::seed_from_u64(seed);
    (0..len).map(|_| rng.random_range(-1.0..1.0)).collect()
}

/// Spec 11.1, word by word.
fn twin(features: &[f64], sweep: &Sweep) -> Vec<f64> {
    let at = |view: usize, x: i64, y: i64, c: usize| {
        let inside = x >= 0 && y >= 0 && x < WIDTH as i64 && y < HEIGHT as i64;
        if inside { features[((view * HEIGHT + y as usize) * WIDTH + x as usize) * CHANNELS + c] } else { 0.0 }
    };
    let mut output = Vec::new();
    for (view, warps) in sweep.warps.iter().enumerate() {
        for y in 0..HEIGHT {
            for (j, offset) in sweep.disparities[view].iter().enumerate() {
                for x in 0..WIDTH {
                    let base = match &sweep.base {
                        Base::Zero => 0.0,
                        Base::PerPixel(base) => base[(view * HEIGHT + y) * WIDTH + x],
                        Base::PerCandidate(base) => base[((view * 6 + j) * HEIGHT + y) * WIDTH + x],
                    };
                    let disparity = f64::from(base + offset);
                    let mut mean = 0.0;
                    for warp in warps {
                        let q: [f64; 3] = std::array::from_fn(|i| {
                            let r = warp.rotation[i].map(f64::from);
                            r[0] * x as f64 + r[1] * y as f64 + r[2] + disparity * f64::from(warp.translation[i])
                        });
                        if q[2] <= 1e-3 {
                            continue;
                        }
                        let (u, v) = (q[0] / q[2], q[1] / q[2]);
                        let (x0, y0) = (u.floor(), v.floor());
                        for c in 0..CHANNELS {
                            let mut sample = 0.0;
                            for (dx, wx) in [(0, 1.0 - (u - x0)), (1, u - x0)] {
                                for (dy, wy) in [(0, 1.0 - (v - y0)), (1, v - y0)] {
                                    sample += wx * wy * at(warp.other, x0 as i64 + dx, y0 as i64 + dy, c);
                                }
                            }
                            mean += at(view, x as i64, y as i64, c) * sample / warps.len() as f64;
                        }
                    }
                    output.push(mean / (CHANNELS as f64).sqrt());
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
fn equals_the_plain_sweep() {
    for base in [Base::Zero, per_pixel(), per_candidate()] {
        let sweep = geometry(base);
        let features = random(3 * WIDTH * HEIGHT * CHANNELS, 1);
        let (fast, plain) = (forward(&features, CHANNELS, &sweep), twin(&in_f64(&features), &sweep));
        assert!(plain.iter().filter(|v| **v != 0.0).count() > plain.len() / 3, "most samples fall outside");
        assert!(plain.contains(&0.0), "no sample falls outside");
        for (i, (a, b)) in fast.iter().zip(&plain).enumerate() {
            assert!((f64::from(*a) - b).abs() < 1e-4, "{i}: {a} vs {b}");
        }
    }
}

#[test]
fn gradient_equals_finite_differences() {
    let sweep = geometry(per_pixel());
    let features = random(3 * WIDTH * HEIGHT * CHANNELS, 2);
    let grad = random(3 * 6 * WIDTH * HEIGHT, 3);
    let analytic = backward(&features, CHANNELS, &sweep, &grad);
    let loss = |f: &[f64]| twin(f, &sweep).iter().zip(&grad).map(|(o, g)| o * f64::from(*g)).sum::<f64>();
    let mut at = in_f64(&features);
    for i in (0..at.len()).step_by(13) {
        let step = 1e-4;
        let centre = at[i];
        at[i] = centre + step;
        let up = loss(&at);
        at[i] = centre - step;
        let numeric = (up - loss(&at)) / (2.0 * step);
        at[i] = centre;
        assert!((f64::from(analytic[i]) - numeric).abs() < 1e-3, "{i}: {} vs {numeric}", analytic[i]);
    }
}

#[test]
fn burn_differentiates_through_it() {
    let device = Device::flex().autodiff();
    let sweep = geometry(Base::Zero);
    let (features, grad) = (random(3 * WIDTH * HEIGHT * CHANNELS, 4), random(3 * 6 * WIDTH * HEIGHT, 5));
    let maps: Tensor<4> = Tensor::from_data(TensorData::new(features.clone(), [3, HEIGHT, WIDTH, CHANNELS]), &device);
    let maps = maps.permute([0, 3, 1, 2]).require_grad();
    let weights: Tensor<4> = Tensor::from_data(TensorData::new(grad.clone(), [3, HEIGHT, 6, WIDTH]), &device);
    let volume = surfel_net::ops::plane_sweep(maps.clone(), Arc::new(sweep.clone()));
    assert_eq!(volume.dims(), [3, 6, HEIGHT, WIDTH]);
    let grads = (volume * weights.permute([0, 2, 1, 3])).sum().backward();
    let through_burn = maps.grad(&grads).unwrap().permute([0, 2, 3, 1]).into_data();
    let direct = TensorData::new(backward(&features, CHANNELS, &sweep, &grad), [3, HEIGHT, WIDTH, CHANNELS]);
    through_burn.assert_approx_eq::<f32>(&direct, burn::tensor::Tolerance::absolute(1e-5));
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let sweep = geometry(Base::Zero);
    let (features, grad) = (random(3 * WIDTH * HEIGHT * CHANNELS, 6), random(3 * 6 * WIDTH * HEIGHT, 7));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (forward(&features, CHANNELS, &sweep), backward(&features, CHANNELS, &sweep, &grad)))
    };
    assert_eq!(run(1), run(3));
}
