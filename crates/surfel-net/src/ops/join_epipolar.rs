//! Joins epipolar attention to burn: one trait, a CPU implementation on Flex, the backward pass once.
//!
//! Invariant: no gradient flows to cameras or depths.

use super::epipolar::EpipolarLines;
use super::epipolar_attention::{self as attention, Inputs};
use super::join::flex;
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, TensorMetadata, backend_extension};
use burn::tensor::Tensor;
use burn_flex::FlexTensor;
use std::sync::Arc;

/// Epipolar attention on a backend's own tensors; queries, keys, values and what depths add to keys and values.
#[backend_extension(Flex, Autodiff)]
pub trait EpipolarOps: Backend {
    /// See [`attention::forward`].
    fn epipolar(
        query: FloatTensor<Self>,
        key: FloatTensor<Self>,
        value: FloatTensor<Self>,
        depth_key: FloatTensor<Self>,
        depth_value: FloatTensor<Self>,
        num_heads: usize,
        lines: Arc<EpipolarLines>,
    ) -> FloatTensor<Self>;
    /// See [`attention::backward`]: the gradients of the five, in order.
    fn epipolar_backward(
        query: FloatTensor<Self>,
        key: FloatTensor<Self>,
        value: FloatTensor<Self>,
        depth_key: FloatTensor<Self>,
        depth_value: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        num_heads: usize,
        lines: Arc<EpipolarLines>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);
}

fn inputs(tensors: &[FlexTensor; 5], num_heads: usize) -> Inputs<'_> {
    let [query, key, value, depth_key, depth_value] = tensors.each_ref().map(|tensor| tensor.storage());
    Inputs { query, key, value, depth_key, depth_value, channels: tensors[0].shape()[3], num_heads }
}

impl EpipolarOps for Flex {
    fn epipolar(
        query: FloatTensor<Self>,
        key: FloatTensor<Self>,
        value: FloatTensor<Self>,
        depth_key: FloatTensor<Self>,
        depth_value: FloatTensor<Self>,
        num_heads: usize,
        lines: Arc<EpipolarLines>,
    ) -> FloatTensor<Self> {
        let tensors = [query, key, value, depth_key, depth_value].map(|tensor| tensor.to_contiguous());
        flex(attention::forward(&inputs(&tensors, num_heads), &lines), tensors[0].shape())
    }

    fn epipolar_backward(
        query: FloatTensor<Self>,
        key: FloatTensor<Self>,
        value: FloatTensor<Self>,
        depth_key: FloatTensor<Self>,
        depth_value: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        num_heads: usize,
        lines: Arc<EpipolarLines>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
        let tensors = [query, key, value, depth_key, depth_value].map(|tensor| tensor.to_contiguous());
        let grads = attention::backward(&inputs(&tensors, num_heads), &lines, grad.to_contiguous().storage());
        let (map, table) = (tensors[0].shape(), tensors[3].shape());
        (
            flex(grads.query, map.clone()),
            flex(grads.key, map.clone()),
            flex(grads.value, map),
            flex(grads.depth_key, table.clone()),
            flex(grads.depth_value, table),
        )
    }
}

impl<B: Backend + EpipolarOps, C: CheckpointStrategy> EpipolarOps for Autodiff<B, C> {
    fn epipolar(
        query: FloatTensor<Self>,
        key: FloatTensor<Self>,
        value: FloatTensor<Self>,
        depth_key: FloatTensor<Self>,
        depth_value: FloatTensor<Self>,
        num_heads: usize,
        lines: Arc<EpipolarLines>,
    ) -> FloatTensor<Self> {
        #[derive(Debug)]
        struct EpipolarBackward;
        impl<B: Backend + EpipolarOps> Backward<B, 5> for EpipolarBackward {
            type State = ([FloatTensor<B>; 5], usize, Arc<EpipolarLines>);
            fn backward(self, ops: Ops<Self::State, 5>, grads: &mut Gradients, _: &mut Checkpointer) {
                let grad = grads.consume::<B>(&ops.node);
                let ([query, key, value, depth_key, depth_value], num_heads, lines) = ops.state;
                let (query, key, value, depth_key, depth_value) =
                    B::epipolar_backward(query, key, value, depth_key, depth_value, grad, num_heads, lines);
                for (parent, grad) in ops.parents.into_iter().zip([query, key, value, depth_key, depth_value]) {
                    if let Some(parent) = parent {
                        grads.register::<B>(parent.id, grad);
                    }
                }
            }
        }
        let [(query, q), (key, k), (value, v), (depth_key, dk), (depth_value, dv)] =
            [query, key, value, depth_key, depth_value].map(|tensor| tensor.into_parts());
        let run = |[query, key, value, depth_key, depth_value]: [FloatTensor<B>; 5], lines| {
            B::epipolar(query, key, value, depth_key, depth_value, num_heads, lines)
        };
        let tensors = [query, key, value, depth_key, depth_value];
        match EpipolarBackward.prepare::<C>([q, k, v, dk, dv]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let state = (tensors.clone(), num_heads, lines.clone());
                prep.finish(state, run(tensors, lines))
            }
            OpsKind::UnTracked(prep) => prep.finish(run(tensors, lines)),
        }
    }

    fn epipolar_backward(
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: usize,
        _: Arc<EpipolarLines>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
        panic!("epipolar attention has no second derivatives: a gradient of it cannot be differentiated again")
    }
}

/// Attention of each pixel along its lines: queries, keys and values `[views, height, width, channels]`, and what
/// each candidate of depth adds to keys and values `[candidates, channels]`.
pub fn epipolar_attention(
    query: Tensor<4>,
    [key, value]: [Tensor<4>; 2],
    [depth_key, depth_value]: [Tensor<2>; 2],
    num_heads: usize,
    lines: Arc<EpipolarLines>,
) -> Tensor<4> {
    let [query, key, value] = [query, key, value].map(|tensor| tensor.into_dispatch());
    let [depth_key, depth_value] = [depth_key, depth_value].map(|tensor| tensor.into_dispatch());
    let y = <Dispatch as EpipolarOps>::epipolar(query, key, value, depth_key, depth_value, num_heads, lines);
    Tensor::from_dispatch(y)
}
