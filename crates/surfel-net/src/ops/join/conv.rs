//! The convolution as a kernel that burn differentiates through; on graphics cards burn's own, or a product of matrices.
//!
//! Invariant: all are the same function, and only the gradients that someone asks for are computed.

use crate::ops::conv::{self, Conv};
use crate::ops::count;
use crate::ops::kernel::{Kernel, SLOTS, run, runs_on};
use burn::tensor::Tensor;
use burn::tensor::ops::{ConvOptions, PadMode};

/// Inputs are the maps, weights and one bias per output.
impl Kernel for Conv {
    fn shape(&self) -> Vec<usize> {
        let (height, width) = self.output_size();
        vec![self.images, self.outputs, height, width]
    }

    fn forward(&self, inputs: &[&[f32]; SLOTS]) -> Vec<f32> {
        let [input, weight, bias, ..] = *inputs;
        conv::forward(self, input, weight, Some(bias))
    }

    fn backward(&self, inputs: &[&[f32]; SLOTS], grad: &[f32], wanted: [bool; SLOTS]) -> [Option<Vec<f32>>; SLOTS] {
        let [input, weight, ..] = *inputs;
        [
            wanted[0].then(|| conv::input_gradient(self, grad, weight)),
            wanted[1].then(|| conv::weight_gradient(self, input, grad)),
            wanted[2].then(|| conv::bias_gradient(self, grad)),
            None,
            None,
        ]
    }
}

/// Convolution of `[images, inputs, height, width]` with weights `[outputs, inputs, kernel, kernel]`, zeros around.
pub fn conv2d(
    input: Tensor<4>,
    weight: Tensor<4>,
    bias: Option<Tensor<1>>,
    stride: usize,
    padding: usize,
) -> Tensor<4> {
    let device = input.device();
    let ([images, inputs, height, width], [outputs, _, kernel, _]) = (input.dims(), weight.dims());
    let sizes = Conv { images, inputs, outputs, kernel, stride, padding, height, width };
    let (rows, columns) = sizes.output_size();
    count::tell_product(&[images, outputs, rows, columns, inputs, kernel, kernel]);
    if !runs_on(&device) {
        // Matrix units round factors to eleven bits, which training does not notice; an answer is to be exact.
        if device.is_autodiff() {
            return by_product(input, weight, bias, &sizes);
        }
        let options = ConvOptions::new([stride; 2], [padding; 2], [1; 2], 1);
        return burn::tensor::module::conv2d(input, weight, bias, options);
    }
    let bias = bias.unwrap_or_else(|| Tensor::zeros([outputs], &device));
    run(&device, [input.into_dispatch(), weight.into_dispatch(), bias.into_dispatch()], sizes)
}

/// The same as the product of the weights and a matrix of all windows. The gradients of burn's own convolutions are slow on
/// graphics cards unless it tries out dozens of kernels for each size, for minutes; those of its product are fast as they are.
fn by_product(input: Tensor<4>, weight: Tensor<4>, bias: Option<Tensor<1>>, sizes: &Conv) -> Tensor<4> {
    let Conv { images, inputs, outputs, kernel, stride, padding, .. } = *sizes;
    let (rows, columns) = sizes.output_size();
    let after = padding + stride - 1;
    let padded = input.pad((padding, after, padding, after), PadMode::Constant(0.0));
    let tap = |i: usize| {
        let tap = padded.clone().narrow(2, i / kernel, rows * stride).narrow(3, i % kernel, columns * stride);
        let blocks: Tensor<6> = tap.reshape([images, inputs, rows, stride, columns, stride]);
        blocks.narrow(3, 0, 1).narrow(5, 0, 1).reshape([images, inputs, rows * columns])
    };
    let length = kernel * kernel * inputs;
    let windows: Tensor<3> = Tensor::cat((0..kernel * kernel).map(tap).collect(), 1);
    let weights: Tensor<3> = weight.permute([0, 2, 3, 1]).reshape([1, outputs, length]);
    let product = weights.matmul(windows).reshape([images, outputs, rows, columns]);
    match bias {
        Some(bias) => product + bias.reshape([1, outputs, 1, 1]),
        None => product,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::values;
    use burn::tensor::{Device, TensorData};

    #[test]
    fn the_product_of_matrices_is_the_kernel_and_so_are_its_gradients() {
        let device = Device::flex().autodiff();
        let wave = |count: usize, speed: f32| {
            let values: Vec<f32> = (0..count).map(|i| (i as f32 * speed).sin()).collect();
            Tensor::<1>::from_data(TensorData::new(values, [count]), &device)
        };
        for (kernel, stride, height, width) in [(3, 1, 6, 5), (1, 1, 4, 7), (3, 2, 6, 8), (3, 2, 7, 5), (5, 1, 5, 6)] {
            let (images, inputs, outputs, padding) = (2, 3, 4, kernel / 2);
            let sizes = Conv { images, inputs, outputs, kernel, stride, padding, height, width };
            let x = wave(images * inputs * height * width, 1.7).reshape([images, inputs, height, width]).require_grad();
            let weight = wave(outputs * inputs * kernel * kernel, 2.3);
            let weight = weight.reshape([outputs, inputs, kernel, kernel]).require_grad();
            let bias = wave(outputs, 0.9).require_grad();
            let answer = |y: Tensor<4>| {
                let [n, c, h, w] = y.dims();
                let gradients = (y.clone() * wave(n * c * h * w, 3.1).reshape([n, c, h, w])).sum().backward();
                let of_bias = bias.grad(&gradients).unwrap();
                let of_maps = [x.grad(&gradients), weight.grad(&gradients)].map(|gradient| values(gradient.unwrap()));
                [of_maps.to_vec(), vec![values(y), values(of_bias)]].concat()
            };
            let expected = answer(conv2d(x.clone(), weight.clone(), Some(bias.clone()), stride, padding));
            let found = answer(by_product(x.clone(), weight.clone(), Some(bias.clone()), &sizes));
            for (expected, found) in expected.iter().zip(&found) {
                assert_eq!(expected.len(), found.len());
                for (expected, found) in expected.iter().zip(found) {
                    assert!((expected - found).abs() < 1e-4, "kernel {kernel}, stride {stride}: {expected}, {found}");
                }
            }
        }
    }
}
