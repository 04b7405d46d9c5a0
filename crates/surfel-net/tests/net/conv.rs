//! The convolution against one written as its definition in f64, its gradients against finite differences of
//! that, and through burn against burn's own.

use burn::tensor::module::conv2d as burn_conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor, TensorData, Tolerance};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use surfel_net::ops::conv::{Conv, bias_gradient, forward, input_gradient, weight_gradient};
use surfel_net::ops::conv2d;

/// Every kernel and stride of the network and some odd ones, on maps that are no multiple of anything.
fn cases() -> Vec<Conv> {
    let mut cases = Vec::new();
    for (kernel, stride, padding) in
        [(1, 1, 0), (3, 1, 1), (7, 1, 3), (1, 2, 0), (3, 2, 1), (7, 2, 3), (3, 1, 0), (3, 3, 1), (2, 2, 0), (3, 2, 2)]
    {
        for (inputs, outputs, height, width) in [(3, 7, 11, 37), (5, 4, 7, 16), (2, 1, 23, 9)] {
            cases.push(Conv { images: 2, inputs, outputs, kernel, stride, padding, height, width });
        }
    }
    // Enough rows and channels for several blocks of each.
    cases.push(Conv { images: 1, inputs: 30, outputs: 7, kernel: 3, stride: 1, padding: 1, height: 24, width: 50 });
    cases
}

fn random(len: usize, seed: u64) -> Vec<f32> {
    let mut rng = StdRng::seed_from_u64(seed);
    (0..len).map(|_| rng.random_range(-1.0..1.0)).collect()
}

struct Values {
    input: Vec<f32>,
    weight: Vec<f32>,
    bias: Vec<f32>,
    grad: Vec<f32>,
}

fn values(conv: &Conv) -> Values {
    let (height, width) = conv.output_size();
    Values {
        input: random(conv.images * conv.inputs * conv.height * conv.width, 1),
        weight: random(conv.outputs * conv.inputs * conv.kernel * conv.kernel, 2),
        bias: random(conv.outputs, 3),
        grad: random(conv.images * conv.outputs * height * width, 4),
    }
}

fn in_f64(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&v| f64::from(v)).collect()
}

/// The definition: a sum over taps that fall inside the map.
fn twin(conv: &Conv, input: &[f64], weight: &[f64], bias: &[f64]) -> Vec<f64> {
    let (height, width) = conv.output_size();
    let mut output = Vec::new();
    for image in 0..conv.images {
        for o in 0..conv.outputs {
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                let mut sum = bias[o];
                for i in 0..conv.inputs {
                    for (ky, kx) in (0..conv.kernel).flat_map(|ky| (0..conv.kernel).map(move |kx| (ky, kx))) {
                        let row = (y * conv.stride + ky).checked_sub(conv.padding).filter(|row| *row < conv.height);
                        let column = (x * conv.stride + kx).checked_sub(conv.padding).filter(|x| *x < conv.width);
                        if let (Some(row), Some(column)) = (row, column) {
                            let weight = weight[((o * conv.inputs + i) * conv.kernel + ky) * conv.kernel + kx];
                            sum +=
                                weight * input[((image * conv.inputs + i) * conv.height + row) * conv.width + column];
                        }
                    }
                }
                output.push(sum);
            }
        }
    }
    output
}

#[test]
fn equals_its_definition() {
    for conv in cases() {
        let v = values(&conv);
        let fast = forward(&conv, &v.input, &v.weight, Some(&v.bias));
        let plain = twin(&conv, &in_f64(&v.input), &in_f64(&v.weight), &in_f64(&v.bias));
        assert_eq!(fast.len(), plain.len(), "{conv:?}");
        for (i, (a, b)) in fast.iter().zip(&plain).enumerate() {
            assert!((f64::from(*a) - b).abs() < 1e-5 * (1.0 + b.abs()), "{conv:?} {i}: {a} vs {b}");
        }
        let without = forward(&conv, &v.input, &v.weight, None);
        assert_eq!(without, forward(&conv, &v.input, &v.weight, Some(&vec![0.0; conv.outputs])));
    }
}

#[test]
fn gradients_equal_finite_differences() {
    for conv in cases() {
        let v = values(&conv);
        let analytic = [
            input_gradient(&conv, &v.grad, &v.weight),
            weight_gradient(&conv, &v.input, &v.grad),
            bias_gradient(&conv, &v.grad),
        ];
        let mut at = [in_f64(&v.input), in_f64(&v.weight), in_f64(&v.bias)];
        let loss = |at: &[Vec<f64>; 3]| -> f64 {
            twin(&conv, &at[0], &at[1], &at[2]).iter().zip(&v.grad).map(|(y, g)| y * f64::from(*g)).sum()
        };
        for (which, analytic) in analytic.iter().enumerate() {
            assert_eq!(analytic.len(), at[which].len(), "{conv:?} {which}");
            for i in (which..analytic.len()).step_by(analytic.len().div_ceil(6)) {
                let centre = at[which][i];
                at[which][i] = centre + 0.5;
                let up = loss(&at);
                at[which][i] = centre - 0.5;
                let numeric = up - loss(&at);
                at[which][i] = centre;
                let error = (f64::from(analytic[i]) - numeric).abs();
                assert!(error < 1e-4 * (1.0 + numeric.abs()), "{conv:?} {which} {i}: {} vs {numeric}", analytic[i]);
            }
        }
    }
}

#[test]
fn burn_differentiates_through_it_as_through_its_own() {
    let device = Device::flex().autodiff();
    for conv in cases().into_iter().filter(|conv| conv.padding < conv.kernel - conv.kernel / 2) {
        let v = values(&conv);
        let (height, width) = conv.output_size();
        let run = |ours: bool| {
            let tensor =
                |v: &[f32], shape: [usize; 4]| Tensor::<4>::from_data(TensorData::new(v.to_vec(), shape), &device);
            let input = tensor(&v.input, [conv.images, conv.inputs, conv.height, conv.width]).require_grad();
            let weight = tensor(&v.weight, [conv.outputs, conv.inputs, conv.kernel, conv.kernel]).require_grad();
            let bias = Tensor::<1>::from_floats(v.bias.as_slice(), &device).require_grad();
            let output = if ours {
                conv2d(input.clone(), weight.clone(), Some(bias.clone()), conv.stride, conv.padding)
            } else {
                let options = ConvOptions::new([conv.stride; 2], [conv.padding; 2], [1; 2], 1);
                burn_conv2d(input.clone(), weight.clone(), Some(bias.clone()), options)
            };
            let grad = tensor(&v.grad, [conv.images, conv.outputs, height, width]);
            let grads = (output.clone() * grad).sum().backward();
            let of = [input.grad(&grads).unwrap().into_data(), weight.grad(&grads).unwrap().into_data()];
            (output.into_data(), of, bias.grad(&grads).unwrap().into_data())
        };
        let (ours, theirs) = (run(true), run(false));
        let tolerance = Tolerance::<f32>::rel_abs(1e-4, 1e-4);
        ours.0.assert_approx_eq(&theirs.0, tolerance);
        ours.1[0].assert_approx_eq(&theirs.1[0], tolerance);
        ours.1[1].assert_approx_eq(&theirs.1[1], tolerance);
        ours.2.assert_approx_eq(&theirs.2, tolerance);
    }
}

#[test]
fn what_nobody_differentiates_gets_no_gradient() {
    let device = Device::flex().autodiff();
    let input = Tensor::<4>::ones([1, 2, 5, 6], &device);
    let weight = Tensor::<4>::ones([3, 2, 3, 3], &device).require_grad();
    let output = conv2d(input.clone(), weight.clone(), None, 1, 1);
    let grads = output.sum().backward();
    assert!(input.grad(&grads).is_none());
    // The middle tap sees all 30 pixels, a corner tap 20.
    let gradient: Vec<f32> = weight.grad(&grads).unwrap().into_data().try_to_vec().unwrap();
    assert_eq!((gradient[0], gradient[4]), (20.0, 30.0));
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    for conv in cases() {
        let v = values(&conv);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let gradients = (input_gradient(&conv, &v.grad, &v.weight), weight_gradient(&conv, &v.input, &v.grad));
                (forward(&conv, &v.input, &v.weight, Some(&v.bias)), gradients, bias_gradient(&conv, &v.grad))
            })
        };
        assert!(run(1) == run(4), "{conv:?}");
    }
}
