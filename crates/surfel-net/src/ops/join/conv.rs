//! The convolution as a kernel that burn differentiates through; burn's own on any device but the CPU.
//!
//! Invariant: only the gradients that someone asks for are computed.

use crate::ops::conv::{self, Conv};
use crate::ops::count;
use crate::ops::kernel::{Kernel, SLOTS, run, runs_on};
use burn::tensor::Tensor;
use burn::tensor::ops::ConvOptions;

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

/// Convolution of `[images, inputs, height, width]` with weights `[outputs, inputs, kernel, kernel]`; burn's own
/// where our kernels do not run.
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
        let options = ConvOptions::new([stride; 2], [padding; 2], [1; 2], 1);
        return burn::tensor::module::conv2d(input, weight, bias, options);
    }
    let bias = bias.unwrap_or_else(|| Tensor::zeros([outputs], &device));
    run(&device, [input.into_dispatch(), weight.into_dispatch(), bias.into_dispatch()], sizes)
}
