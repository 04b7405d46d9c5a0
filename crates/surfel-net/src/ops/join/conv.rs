//! Joins the convolution to burn: our kernels on Flex, burn's own convolution on any other backend.
//!
//! Invariant: only the gradients that someone asks for are computed.

use super::flex;
use crate::ops::conv::{self, Conv};
use crate::ops::kernel::runs_on;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::Tensor;
use burn::tensor::ops::ConvOptions;

/// Convolution on a backend's own tensors.
#[backend_extension(Flex, Autodiff)]
pub trait ConvOps: Backend {
    /// See [`conv::forward`].
    fn conv(
        input: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        sizes: Conv,
    ) -> FloatTensor<Self>;
    /// See [`conv::input_gradient`].
    fn conv_input_gradient(weight: FloatTensor<Self>, grad: FloatTensor<Self>, sizes: Conv) -> FloatTensor<Self>;
    /// See [`conv::weight_gradient`].
    fn conv_weight_gradient(input: FloatTensor<Self>, grad: FloatTensor<Self>, sizes: Conv) -> FloatTensor<Self>;
    /// See [`conv::bias_gradient`].
    fn conv_bias_gradient(grad: FloatTensor<Self>, sizes: Conv) -> FloatTensor<Self>;
}

impl ConvOps for Flex {
    fn conv(
        input: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        sizes: Conv,
    ) -> FloatTensor<Self> {
        let [input, weight, bias] = [input, weight, bias].map(|t| t.to_contiguous());
        let output = conv::forward(&sizes, input.storage(), weight.storage(), Some(bias.storage()));
        let (height, width) = sizes.output_size();
        flex(output, [sizes.images, sizes.outputs, height, width])
    }

    fn conv_input_gradient(weight: FloatTensor<Self>, grad: FloatTensor<Self>, sizes: Conv) -> FloatTensor<Self> {
        let [weight, grad] = [weight, grad].map(|t| t.to_contiguous());
        let values = conv::input_gradient(&sizes, grad.storage(), weight.storage());
        flex(values, [sizes.images, sizes.inputs, sizes.height, sizes.width])
    }

    fn conv_weight_gradient(input: FloatTensor<Self>, grad: FloatTensor<Self>, sizes: Conv) -> FloatTensor<Self> {
        let [input, grad] = [input, grad].map(|t| t.to_contiguous());
        let values = conv::weight_gradient(&sizes, input.storage(), grad.storage());
        flex(values, [sizes.outputs, sizes.inputs, sizes.kernel, sizes.kernel])
    }

    fn conv_bias_gradient(grad: FloatTensor<Self>, sizes: Conv) -> FloatTensor<Self> {
        flex(conv::bias_gradient(&sizes, grad.to_contiguous().storage()), [sizes.outputs])
    }
}

impl<B: Backend + ConvOps, C: CheckpointStrategy> ConvOps for Autodiff<B, C> {
    fn conv(
        input: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        sizes: Conv,
    ) -> FloatTensor<Self> {
        #[derive(Debug)]
        struct ConvBackward;
        impl<B: Backend + ConvOps> Backward<B, 3> for ConvBackward {
            type State = ([FloatTensor<B>; 2], Conv);
            fn backward(self, ops: Ops<Self::State, 3>, grads: &mut Gradients, _: &mut Checkpointer) {
                let grad = grads.consume::<B>(&ops.node);
                let ([input, weight], sizes) = ops.state;
                let [of_input, of_weight, of_bias] = ops.parents;
                if let Some(parent) = of_bias {
                    grads.register::<B>(parent.id, B::conv_bias_gradient(grad.clone(), sizes));
                }
                if let Some(parent) = of_weight {
                    grads.register::<B>(parent.id, B::conv_weight_gradient(input, grad.clone(), sizes));
                }
                if let Some(parent) = of_input {
                    grads.register::<B>(parent.id, B::conv_input_gradient(weight, grad, sizes));
                }
            }
        }
        let [(input, i), (weight, w), (bias, b)] = [input, weight, bias].map(|t| t.into_parts());
        match ConvBackward.prepare::<C>([i, w, b]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let state = ([input.clone(), weight.clone()], sizes);
                prep.finish(state, B::conv(input, weight, bias, sizes))
            }
            OpsKind::UnTracked(prep) => prep.finish(B::conv(input, weight, bias, sizes)),
        }
    }

    fn conv_input_gradient(_: FloatTensor<Self>, _: FloatTensor<Self>, _: Conv) -> FloatTensor<Self> {
        no_second_derivatives()
    }

    fn conv_weight_gradient(_: FloatTensor<Self>, _: FloatTensor<Self>, _: Conv) -> FloatTensor<Self> {
        no_second_derivatives()
    }

    fn conv_bias_gradient(_: FloatTensor<Self>, _: Conv) -> FloatTensor<Self> {
        no_second_derivatives()
    }
}

fn no_second_derivatives() -> ! {
    panic!("the convolution has no second derivatives: a gradient of it cannot be differentiated again")
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
    if !runs_on(&input.device()) {
        let options = ConvOptions::new([stride; 2], [padding; 2], [1; 2], 1);
        return burn::tensor::module::conv2d(input, weight, bias, options);
    }
    let ([images, inputs, height, width], [outputs, _, kernel, _]) = (input.dims(), weight.dims());
    let sizes = Conv { images, inputs, outputs, kernel, stride, padding, height, width };
    let bias = bias.unwrap_or_else(|| Tensor::zeros([outputs], &input.device()));
    let (input, weight, bias) = (input.into_dispatch(), weight.into_dispatch(), bias.into_dispatch());
    Tensor::from_dispatch(<Dispatch as ConvOps>::conv(input, weight, bias, sizes))
}
