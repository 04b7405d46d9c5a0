//! Activations against their definitions in f64, and their slopes against finite differences of these.

use surfel_net::ops::Activation;
use surfel_net::ops::activation::{backward, forward};

pub(super) const ALL: [Activation; 4] = [Activation::Identity, Activation::Relu, Activation::Silu, Activation::Gelu];

/// The definition. The Gaussian integral is its power series, which serves up to four; beyond, it is one to 2e-8.
pub(super) fn twin(activation: Activation, x: f64) -> f64 {
    match activation {
        Activation::Identity => x,
        Activation::Relu => x.max(0.0),
        Activation::Silu => x / (1.0 + (-x).exp()),
        Activation::Gelu => 0.5 * x * (1.0 + erf(x / 2f64.sqrt())),
    }
}

fn erf(z: f64) -> f64 {
    if z.abs() > 4.0 {
        return z.signum();
    }
    let (mut term, mut sum) = (z, z);
    for n in 1..120 {
        term *= -z * z / n as f64;
        sum += term / (2 * n + 1) as f64;
    }
    sum * 2.0 / std::f64::consts::PI.sqrt()
}

/// Dense where the curves bend, and far out on both sides; no multiple of any vector.
fn arguments() -> Vec<f32> {
    let dense = (-12_000..=12_000).map(|i| i as f32 * 1e-3 + 3e-4);
    dense.chain([-1e30, -300.0, -88.5, -40.0, 40.0, 88.5, 300.0, 1e30]).collect()
}

#[test]
fn equals_its_definition() {
    let x = arguments();
    for activation in ALL {
        for (x, y) in x.iter().zip(forward(activation, &x)) {
            let expected = twin(activation, f64::from(*x));
            let error = (f64::from(y) - expected).abs();
            assert!(error < 1e-6 * (1.0 + expected.abs()), "{activation:?}({x}) = {y}, not {expected}");
        }
    }
}

#[test]
fn slopes_equal_finite_differences() {
    const STEP: f64 = 1e-4;
    let x = arguments();
    let grad: Vec<f32> = (0..x.len()).map(|i| 0.5 + (i % 7) as f32).collect();
    for activation in ALL {
        for ((x, grad), slope) in x.iter().zip(&grad).zip(backward(activation, &x, &grad)) {
            // A kink, and arguments that swallow the step.
            if (activation == Activation::Relu && x.abs() < 1e-3) || x.abs() > 1e3 {
                continue;
            }
            let at = f64::from(*x);
            let numeric = (twin(activation, at + STEP) - twin(activation, at - STEP)) / (2.0 * STEP);
            let error = (f64::from(slope) / f64::from(*grad) - numeric).abs();
            assert!(
                error < 2e-6 + 1e-7 * at.abs(),
                "slope of {activation:?} at {x}: {slope} over {grad}, not {numeric}"
            );
        }
    }
}

#[test]
fn what_is_no_number_stays_none() {
    for activation in [Activation::Silu, Activation::Gelu] {
        assert!(forward(activation, &[f32::NAN])[0].is_nan(), "{activation:?} hides a fault");
    }
}
