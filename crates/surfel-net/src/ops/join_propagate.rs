//! Joins plane propagation to burn: one trait, a CPU implementation on Flex, the backward pass once.
//!
//! Invariant: no gradient flows to the proposing planes.

use super::propagate::{self, Proposals};
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, TensorMetadata, backend_extension};
use burn::tensor::{Tensor, TensorData};
use burn_flex::FlexTensor;
use std::sync::Arc;

/// Plane propagation on a backend's own tensors.
#[backend_extension(Flex, Autodiff)]
pub trait PropagateOps: Backend {
    /// See [`propagate::forward`].
    fn propagate(scores: FloatTensor<Self>, proposals: Arc<Proposals>) -> FloatTensor<Self>;
    /// See [`propagate::backward`].
    fn propagate_backward(
        scores: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        proposals: Arc<Proposals>,
    ) -> FloatTensor<Self>;
}

impl PropagateOps for Flex {
    fn propagate(scores: FloatTensor<Self>, proposals: Arc<Proposals>) -> FloatTensor<Self> {
        let scores = scores.to_contiguous();
        let planes = propagate::forward(scores.storage(), &proposals);
        FlexTensor::from_data(TensorData::new(planes, [proposals.num_views(), 3, proposals.height, proposals.width]))
    }

    fn propagate_backward(
        scores: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        proposals: Arc<Proposals>,
    ) -> FloatTensor<Self> {
        let (scores, grad) = (scores.to_contiguous(), grad.to_contiguous());
        let shape = scores.shape();
        FlexTensor::from_data(TensorData::new(propagate::backward(scores.storage(), &proposals, grad.storage()), shape))
    }
}

impl<B: Backend + PropagateOps, C: CheckpointStrategy> PropagateOps for Autodiff<B, C> {
    fn propagate(scores: FloatTensor<Self>, proposals: Arc<Proposals>) -> FloatTensor<Self> {
        #[derive(Debug)]
        struct PropagateBackward;
        impl<B: Backend + PropagateOps> Backward<B, 1> for PropagateBackward {
            type State = (FloatTensor<B>, Arc<Proposals>);
            fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
                let grad = grads.consume::<B>(&ops.node);
                let (scores, proposals) = ops.state;
                if let [Some(parent)] = ops.parents {
                    grads.register::<B>(parent.id, B::propagate_backward(scores, grad, proposals));
                }
            }
        }
        let (scores, node) = scores.into_parts();
        match PropagateBackward.prepare::<C>([node]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let state = (scores.clone(), proposals.clone());
                prep.finish(state, B::propagate(scores, proposals))
            }
            OpsKind::UnTracked(prep) => prep.finish(B::propagate(scores, proposals)),
        }
    }

    fn propagate_backward(_: FloatTensor<Self>, _: FloatTensor<Self>, _: Arc<Proposals>) -> FloatTensor<Self> {
        panic!("plane propagation has no second derivatives: a gradient of it cannot be differentiated again")
    }
}

/// Planes `[views, 3, height, width]` of scores `[views, proposals, height / stride, width / stride]`.
pub fn propagate(scores: Tensor<4>, proposals: Arc<Proposals>) -> Tensor<4> {
    Tensor::from_dispatch(<Dispatch as PropagateOps>::propagate(scores.into_dispatch(), proposals))
}
