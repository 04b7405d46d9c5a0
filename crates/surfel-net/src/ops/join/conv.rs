//! The convolution as a kernel that burn differentiates through; a graphics card that only answers uses burn's own.
//!
//! Invariant: all are the same function, and only the gradients that someone asks for are computed.

#[cfg(any(feature = "cuda", feature = "wgpu"))]
use crate::ops::card::{self, OnCard};
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

    #[cfg(any(feature = "cuda", feature = "wgpu"))]
    fn on_card(&self, inputs: &[OnCard; SLOTS]) -> Option<OnCard> {
        let [input, weight, bias, ..] = inputs;
        Some(card::conv(input, weight, bias, self))
    }

    #[cfg(any(feature = "cuda", feature = "wgpu"))]
    fn gradients_on_card(
        &self,
        inputs: &[OnCard; SLOTS],
        grad: &OnCard,
        wanted: [bool; SLOTS],
    ) -> Option<[Option<OnCard>; SLOTS]> {
        let [input, weight, ..] = inputs;
        let [of_input, of_weight, of_bias] =
            card::conv_gradients(input, weight, grad, [wanted[0], wanted[1], wanted[2]], self);
        Some([of_input, of_weight, of_bias, None, None])
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
    // Matrix units of a card round factors to eleven bits, which training does not notice; an answer is to be exact.
    if !runs_on(&device) && !device.is_autodiff() {
        let options = ConvOptions::new([stride; 2], [padding; 2], [1; 2], 1);
        return burn::tensor::module::conv2d(input, weight, bias, options);
    }
    let bias = bias.unwrap_or_else(|| Tensor::zeros([outputs], &device));
    run(&device, [input.into_dispatch(), weight.into_dispatch(), bias.into_dispatch()], sizes)
}
