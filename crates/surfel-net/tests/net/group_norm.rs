//! The fused normalisation against its definition in f64, its gradients against finite differences of that, and
//! through burn against burn's own.

use super::activation::{ALL, twin as curve};
use burn::nn::GroupNormConfig;
use burn::tensor::{Device, Tensor, TensorData, Tolerance};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use surfel_net::ops::group_norm::Normalisation;
use surfel_net::ops::kernel::Kernel;
use surfel_net::ops::{Activation, group_norm};

fn random(len: usize, seed: u64) -> Vec<f32> {
    let mut rng = StdRng::seed_from_u64(seed);
    (0..len).map(|_| rng.random_range(-1.5..1.5)).collect()
}

/// Several groups, a single one, one per channel; maps shorter and longer than a run, of odd sizes.
fn cases() -> Vec<Normalisation> {
    let sizes = [([2, 6, 3, 5], 2), ([1, 4, 7, 9], 1), ([2, 3, 4, 4], 3), ([1, 4, 37, 61], 2)];
    let with = |(shape, groups): ([usize; 4], usize)| {
        ALL.into_iter().flat_map(move |activation| {
            [false, true].map(|residual| Normalisation { shape, groups, epsilon: 1e-3, activation, residual })
        })
    };
    sizes.into_iter().flat_map(with).collect()
}

/// Maps that are not centred, scales, shifts, residual, and the gradient of the output.
fn values(case: &Normalisation) -> ([Vec<f32>; 4], Vec<f32>) {
    let len = case.shape.iter().product();
    let x = random(len, 1).iter().map(|x| x + 0.7).collect();
    ([x, random(case.shape[1], 2), random(case.shape[1], 3), random(len, 4)], random(len, 5))
}

fn twin(case: &Normalisation, inputs: &[Vec<f64>; 4]) -> Vec<f64> {
    let [x, scales, shifts, residual] = inputs;
    let pixels = case.shape[2] * case.shape[3];
    let group = pixels * case.shape[1] / case.groups;
    let statistics = |members: &[f64]| {
        let mean = members.iter().sum::<f64>() / group as f64;
        let variance = members.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / group as f64;
        [mean, (variance + f64::from(case.epsilon)).sqrt()]
    };
    let of_groups: Vec<[f64; 2]> = x.chunks_exact(group).map(statistics).collect();
    let value = |i: usize| {
        let [mean, deviation] = of_groups[i / group];
        let c = i / pixels % case.shape[1];
        let y = curve(case.activation, (x[i] - mean) / deviation * scales[c] + shifts[c]);
        y + if case.residual { residual[i] } else { 0.0 }
    };
    (0..x.len()).map(value).collect()
}

fn in_f64(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&v| f64::from(v)).collect()
}

fn slots(inputs: &[Vec<f32>; 4]) -> [&[f32]; 5] {
    [&inputs[0], &inputs[1], &inputs[2], &inputs[3], &[]]
}

#[test]
fn equals_its_definition() {
    for case in cases() {
        let (inputs, _) = values(&case);
        let fast = case.forward(&slots(&inputs));
        let plain = twin(&case, &inputs.each_ref().map(|v| in_f64(v)));
        for (i, (a, b)) in fast.iter().zip(&plain).enumerate() {
            assert!((f64::from(*a) - b).abs() < 3e-6 * (1.0 + b.abs()), "{case:?} {i}: {a} vs {b}");
        }
    }
}

#[test]
fn gradients_equal_finite_differences() {
    const STEP: f64 = 1e-5;
    // A kink makes differences meaningless where a value crosses it.
    for case in cases().into_iter().filter(|case| case.activation != Activation::Relu) {
        let (inputs, grad) = values(&case);
        let analytic = case.backward(&slots(&inputs), &grad, [true; 5]);
        let mut at = inputs.each_ref().map(|v| in_f64(v));
        let loss =
            |at: &[Vec<f64>; 4]| -> f64 { twin(&case, at).iter().zip(&grad).map(|(y, g)| y * f64::from(*g)).sum() };
        for which in 0..4 {
            let Some(analytic) = &analytic[which] else {
                assert!(which == 3 && !case.residual, "{case:?} lacks gradient {which}");
                continue;
            };
            for i in (0..analytic.len()).step_by(analytic.len().div_ceil(7)) {
                let centre = at[which][i];
                at[which][i] = centre + STEP;
                let up = loss(&at);
                at[which][i] = centre - STEP;
                let numeric = (up - loss(&at)) / (2.0 * STEP);
                at[which][i] = centre;
                let error = (f64::from(analytic[i]) - numeric).abs();
                assert!(error < 1e-4 * (1.0 + numeric.abs()), "{case:?} {which} {i}: {} vs {numeric}", analytic[i]);
            }
        }
    }
}

#[test]
fn burn_differentiates_through_it_as_through_its_own() {
    let device = Device::flex().autodiff();
    for case in cases() {
        let (inputs, grad) = values(&case);
        let run = |ours: bool| {
            let map = |v: &[f32]| Tensor::<4>::from_data(TensorData::new(v.to_vec(), case.shape), &device);
            let vector = |v: &[f32]| Tensor::<1>::from_floats(v, &device).require_grad();
            let mut norm = GroupNormConfig::new(case.groups, case.shape[1]).with_epsilon(1e-3).init(&device);
            let (scales, shifts) = (vector(&inputs[1]), vector(&inputs[2]));
            norm.gamma = Some(burn::module::Param::from_tensor(scales));
            norm.beta = Some(burn::module::Param::from_tensor(shifts));
            let (x, residual) = (map(&inputs[0]).require_grad(), map(&inputs[3]).require_grad());
            let added = case.residual.then(|| residual.clone());
            let output = if ours {
                group_norm(&norm, x.clone(), case.activation, added)
            } else {
                let y = norm.forward(x.clone());
                let y = match case.activation {
                    Activation::Identity => y,
                    Activation::Relu => burn::tensor::activation::relu(y),
                    Activation::Silu => burn::tensor::activation::silu(y),
                    Activation::Gelu => burn::tensor::activation::gelu(y),
                };
                added.map_or(y.clone(), |added| y + added)
            };
            let grads = (output.clone() * map(&grad)).sum().backward();
            let of_param = |param: &Option<burn::module::Param<Tensor<1>>>| {
                param.as_ref().unwrap().val().grad(&grads).unwrap().into_data()
            };
            let of = [x.grad(&grads), residual.grad(&grads)].map(|grad| grad.map(Tensor::into_data));
            (output.into_data(), of, [of_param(&norm.gamma), of_param(&norm.beta)])
        };
        let (ours, theirs) = (run(true), run(false));
        let tolerance = Tolerance::<f32>::rel_abs(1e-4, 1e-4);
        ours.0.assert_approx_eq(&theirs.0, tolerance);
        for (ours, theirs) in ours.1.iter().zip(&theirs.1) {
            assert_eq!(ours.is_some(), theirs.is_some(), "{case:?}");
            if let (Some(ours), Some(theirs)) = (ours, theirs) {
                ours.assert_approx_eq(theirs, tolerance);
            }
        }
        ours.2.iter().zip(&theirs.2).for_each(|(ours, theirs)| ours.assert_approx_eq(theirs, tolerance));
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    for case in cases() {
        let (inputs, grad) = values(&case);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| (case.forward(&slots(&inputs)), case.backward(&slots(&inputs), &grad, [true; 5])))
        };
        assert!(run(1) == run(4), "{case:?}");
    }
}
