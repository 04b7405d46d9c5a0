//! The frame that joins a kernel on plain slices to burn, written once for all kernels.
//!
//! A kernel says what it computes and its gradients; this file moves tensors in and out and registers the backward
//! pass. Tensors of a graphics card (`cube.rs`) stay there where a kernel has a twin for cards, else they come to the CPU
//! and go back. Invariant: only the gradients that someone asks for are computed, and none of them again.

#[cfg(any(feature = "cuda", feature = "wgpu"))]
mod cube;

#[cfg(any(feature = "cuda", feature = "wgpu"))]
use super::card::OnCard;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::backend_extension;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, DispatchDevice, DispatchTensor, Flex, TensorMetadata};
use burn::tensor::{Device, Tensor, TensorData};
use burn_flex::FlexTensor;
use std::fmt::Debug;
use std::sync::Arc;

/// Most inputs of a kernel; those it lacks are filled with blank tensors, which nothing reads.
pub const SLOTS: usize = 5;

/// A differentiable function of some arrays, with everything else it needs inside.
pub trait Kernel: Debug + Send + Sync + 'static {
    /// Shape of the output.
    fn shape(&self) -> Vec<usize>;
    /// The output; inputs are row-major.
    fn forward(&self, inputs: &[&[f32]; SLOTS]) -> Vec<f32>;
    /// The gradients of the inputs that are wanted, given that of the output; others are not looked at.
    fn backward(&self, inputs: &[&[f32]; SLOTS], grad: &[f32], wanted: [bool; SLOTS]) -> [Option<Vec<f32>>; SLOTS];
    /// The output, computed on the graphics card that the inputs are on, if there is a kernel for it.
    #[cfg(any(feature = "cuda", feature = "wgpu"))]
    fn on_card(&self, _inputs: &[OnCard; SLOTS]) -> Option<OnCard> {
        None
    }
    /// The gradients of the inputs that are wanted, likewise; others are not looked at.
    #[cfg(any(feature = "cuda", feature = "wgpu"))]
    fn gradients_on_card(
        &self,
        _inputs: &[OnCard; SLOTS],
        _grad: &OnCard,
        _wanted: [bool; SLOTS],
    ) -> Option<[Option<OnCard>; SLOTS]> {
        None
    }
}

/// Kernels on a backend's own tensors.
#[backend_extension(Flex, Cube: cfg(any(feature = "cuda", feature = "wgpu")), Autodiff)]
pub trait KernelOps: Backend {
    /// See [`Kernel::forward`].
    fn kernel(
        a: FloatTensor<Self>,
        b: FloatTensor<Self>,
        c: FloatTensor<Self>,
        d: FloatTensor<Self>,
        e: FloatTensor<Self>,
        kernel: Arc<dyn Kernel>,
    ) -> FloatTensor<Self>;
    /// See [`Kernel::backward`].
    fn kernel_gradients(
        a: FloatTensor<Self>,
        b: FloatTensor<Self>,
        c: FloatTensor<Self>,
        d: FloatTensor<Self>,
        e: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        wanted: [bool; SLOTS],
        kernel: Arc<dyn Kernel>,
    ) -> Vec<Option<FloatTensor<Self>>>;
}

/// True where our kernels are the fastest way: on burn's Flex backend, differentiated or not.
pub(crate) fn runs_on(device: &Device) -> bool {
    matches!(device.clone().inner().as_dispatch(), DispatchDevice::Flex(_))
}

impl KernelOps for Flex {
    fn kernel(
        a: FloatTensor<Self>,
        b: FloatTensor<Self>,
        c: FloatTensor<Self>,
        d: FloatTensor<Self>,
        e: FloatTensor<Self>,
        kernel: Arc<dyn Kernel>,
    ) -> FloatTensor<Self> {
        let inputs = [a, b, c, d, e].map(|t| t.to_contiguous());
        let output = kernel.forward(&inputs.each_ref().map(FlexTensor::storage));
        FlexTensor::from_data(TensorData::new(output, kernel.shape()))
    }

    fn kernel_gradients(
        a: FloatTensor<Self>,
        b: FloatTensor<Self>,
        c: FloatTensor<Self>,
        d: FloatTensor<Self>,
        e: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        wanted: [bool; SLOTS],
        kernel: Arc<dyn Kernel>,
    ) -> Vec<Option<FloatTensor<Self>>> {
        let inputs = [a, b, c, d, e].map(|t| t.to_contiguous());
        let grad = grad.to_contiguous();
        let grads = kernel.backward(&inputs.each_ref().map(FlexTensor::storage), grad.storage(), wanted);
        let shaped = |(grad, input): (Option<Vec<f32>>, &FlexTensor)| {
            grad.map(|grad| FlexTensor::from_data(TensorData::new(grad, input.shape())))
        };
        grads.into_iter().zip(&inputs).map(shaped).collect()
    }
}

impl<B: Backend + KernelOps, C: CheckpointStrategy> KernelOps for Autodiff<B, C> {
    fn kernel(
        a: FloatTensor<Self>,
        b: FloatTensor<Self>,
        c: FloatTensor<Self>,
        d: FloatTensor<Self>,
        e: FloatTensor<Self>,
        kernel: Arc<dyn Kernel>,
    ) -> FloatTensor<Self> {
        #[derive(Debug)]
        struct KernelBackward;
        impl<B: Backend + KernelOps> Backward<B, SLOTS> for KernelBackward {
            type State = ([FloatTensor<B>; SLOTS], Arc<dyn Kernel>);
            fn backward(self, ops: Ops<Self::State, SLOTS>, grads: &mut Gradients, _: &mut Checkpointer) {
                let grad = grads.consume::<B>(&ops.node);
                let ([a, b, c, d, e], kernel) = ops.state;
                let wanted = ops.parents.each_ref().map(Option::is_some);
                let found = B::kernel_gradients(a, b, c, d, e, grad, wanted, kernel);
                for (parent, grad) in ops.parents.into_iter().zip(found) {
                    if let (Some(parent), Some(grad)) = (parent, grad) {
                        grads.register::<B>(parent.id, grad);
                    }
                }
            }
        }
        let [(a, i), (b, j), (c, k), (d, l), (e, m)] = [a, b, c, d, e].map(|t| t.into_parts());
        match KernelBackward.prepare::<C>([i, j, k, l, m]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let kept = [&a, &b, &c, &d, &e].map(Clone::clone);
                let output = B::kernel(a, b, c, d, e, kernel.clone());
                prep.finish((kept, kernel), output)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::kernel(a, b, c, d, e, kernel)),
        }
    }

    fn kernel_gradients(
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: [bool; SLOTS],
        _: Arc<dyn Kernel>,
    ) -> Vec<Option<FloatTensor<Self>>> {
        panic!("our operators have no second derivatives: their gradients cannot be differentiated again")
    }
}

/// A tensor that nothing reads.
pub(super) fn blank(device: &Device) -> DispatchTensor {
    Tensor::<1>::zeros([1], device).into_dispatch()
}

/// The output of a kernel of at most [`SLOTS`] inputs on `device`, which burn differentiates through.
pub(super) fn run<const N: usize, const D: usize>(
    device: &Device,
    inputs: [DispatchTensor; N],
    kernel: impl Kernel,
) -> Tensor<D> {
    const { assert!(N <= SLOTS) };
    let mut inputs = inputs.into_iter();
    let [a, b, c, d, e] = std::array::from_fn(|_| inputs.next().unwrap_or_else(|| blank(device)));
    Tensor::from_dispatch(<Dispatch as KernelOps>::kernel(a, b, c, d, e, Arc::new(kernel)))
}
