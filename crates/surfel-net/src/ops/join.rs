//! Joins the two hot operators to burn: one trait, a CPU implementation on Flex, the backward pass once.
//!
//! Other backends implement the same trait with kernels of their own; the models call only the functions
//! at the end. Invariant: no gradient flows to geometry (poses, candidates, regions).

pub(super) mod conv;

use super::gather_attention::{self as attention, Inputs, Regions};
use super::plane_sweep::{self as sweep, Sweep};
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, TensorMetadata, backend_extension};
use burn::tensor::{Shape, Tensor, TensorData};
use burn_flex::FlexTensor;
use std::sync::Arc;

/// Our operators on a backend's own tensors.
#[backend_extension(Flex, Autodiff)]
pub trait SurfelOps: Backend {
    /// See [`sweep::forward`].
    fn sweep(features: FloatTensor<Self>, geometry: Arc<Sweep>) -> FloatTensor<Self>;
    /// See [`sweep::backward`].
    fn sweep_backward(features: FloatTensor<Self>, grad: FloatTensor<Self>, geometry: Arc<Sweep>) -> FloatTensor<Self>;
    /// See [`attention::forward`].
    fn gather(
        query: FloatTensor<Self>,
        key: FloatTensor<Self>,
        value: FloatTensor<Self>,
        num_heads: usize,
        regions: Arc<Regions>,
    ) -> FloatTensor<Self>;
    /// See [`attention::backward`]: the gradients of query, key and value.
    fn gather_backward(
        query: FloatTensor<Self>,
        key: FloatTensor<Self>,
        value: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        num_heads: usize,
        regions: Arc<Regions>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);
}

/// A tensor of the CPU backend.
pub(super) fn flex(values: Vec<f32>, shape: impl Into<Shape>) -> FlexTensor {
    FlexTensor::from_data(TensorData::new(values, shape))
}

impl SurfelOps for Flex {
    fn sweep(features: FloatTensor<Self>, geometry: Arc<Sweep>) -> FloatTensor<Self> {
        let features = features.to_contiguous();
        let values = sweep::forward(features.storage(), features.shape()[3], &geometry);
        flex(values, [geometry.num_views(), geometry.height, geometry.num_candidates(), geometry.width])
    }

    fn sweep_backward(features: FloatTensor<Self>, grad: FloatTensor<Self>, geometry: Arc<Sweep>) -> FloatTensor<Self> {
        let (features, grad) = (features.to_contiguous(), grad.to_contiguous());
        let shape = features.shape();
        flex(sweep::backward(features.storage(), shape[3], &geometry, grad.storage()), shape)
    }

    fn gather(
        query: FloatTensor<Self>,
        key: FloatTensor<Self>,
        value: FloatTensor<Self>,
        num_heads: usize,
        regions: Arc<Regions>,
    ) -> FloatTensor<Self> {
        let [query, key, value] = [query, key, value].map(|t| t.to_contiguous());
        flex(attention::forward(&inputs(&query, &key, &value, num_heads), &regions), query.shape())
    }

    fn gather_backward(
        query: FloatTensor<Self>,
        key: FloatTensor<Self>,
        value: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        num_heads: usize,
        regions: Arc<Regions>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
        let [query, key, value, grad] = [query, key, value, grad].map(|t| t.to_contiguous());
        let grads = attention::backward(&inputs(&query, &key, &value, num_heads), &regions, grad.storage());
        let shape = query.shape();
        (flex(grads.query, shape.clone()), flex(grads.key, shape.clone()), flex(grads.value, shape))
    }
}

fn inputs<'a>(query: &'a FlexTensor, key: &'a FlexTensor, value: &'a FlexTensor, num_heads: usize) -> Inputs<'a> {
    let channels = query.shape()[1];
    Inputs { query: query.storage(), key: key.storage(), value: value.storage(), channels, num_heads }
}

impl<B: Backend + SurfelOps, C: CheckpointStrategy> SurfelOps for Autodiff<B, C> {
    fn sweep(features: FloatTensor<Self>, geometry: Arc<Sweep>) -> FloatTensor<Self> {
        #[derive(Debug)]
        struct SweepBackward;
        impl<B: Backend + SurfelOps> Backward<B, 1> for SweepBackward {
            type State = (FloatTensor<B>, Arc<Sweep>);
            fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
                let grad = grads.consume::<B>(&ops.node);
                let (features, geometry) = ops.state;
                if let [Some(parent)] = ops.parents {
                    grads.register::<B>(parent.id, B::sweep_backward(features, grad, geometry));
                }
            }
        }
        let (features, node) = features.into_parts();
        match SweepBackward.prepare::<C>([node]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let state = (features.clone(), geometry.clone());
                prep.finish(state, B::sweep(features, geometry))
            }
            OpsKind::UnTracked(prep) => prep.finish(B::sweep(features, geometry)),
        }
    }

    fn sweep_backward(_: FloatTensor<Self>, _: FloatTensor<Self>, _: Arc<Sweep>) -> FloatTensor<Self> {
        panic!("the plane sweep has no second derivatives: a gradient of it cannot be differentiated again")
    }

    fn gather(
        query: FloatTensor<Self>,
        key: FloatTensor<Self>,
        value: FloatTensor<Self>,
        num_heads: usize,
        regions: Arc<Regions>,
    ) -> FloatTensor<Self> {
        #[derive(Debug)]
        struct GatherBackward;
        impl<B: Backend + SurfelOps> Backward<B, 3> for GatherBackward {
            type State = ([FloatTensor<B>; 3], usize, Arc<Regions>);
            fn backward(self, ops: Ops<Self::State, 3>, grads: &mut Gradients, _: &mut Checkpointer) {
                let grad = grads.consume::<B>(&ops.node);
                let ([query, key, value], num_heads, regions) = ops.state;
                let (query, key, value) = B::gather_backward(query, key, value, grad, num_heads, regions);
                for (parent, grad) in ops.parents.into_iter().zip([query, key, value]) {
                    if let Some(parent) = parent {
                        grads.register::<B>(parent.id, grad);
                    }
                }
            }
        }
        let [(query, q), (key, k), (value, v)] = [query, key, value].map(|t| t.into_parts());
        match GatherBackward.prepare::<C>([q, k, v]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let state = ([query.clone(), key.clone(), value.clone()], num_heads, regions.clone());
                prep.finish(state, B::gather(query, key, value, num_heads, regions))
            }
            OpsKind::UnTracked(prep) => prep.finish(B::gather(query, key, value, num_heads, regions)),
        }
    }

    fn gather_backward(
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: usize,
        _: Arc<Regions>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
        panic!("the gather attention has no second derivatives: a gradient of it cannot be differentiated again")
    }
}

/// Plane-sweep correlation `[views, candidates, height, width]` of features `[views, channels, height, width]`.
pub fn plane_sweep(features: Tensor<4>, geometry: Arc<Sweep>) -> Tensor<4> {
    let features = features.permute([0, 2, 3, 1]);
    let volume: Tensor<4> = Tensor::from_dispatch(<Dispatch as SurfelOps>::sweep(features.into_dispatch(), geometry));
    volume.permute([0, 2, 1, 3])
}

/// Attention of each surfel over its regions; all tensors `[surfels, channels]`.
pub fn gather_attention(
    query: Tensor<2>,
    key: Tensor<2>,
    value: Tensor<2>,
    num_heads: usize,
    regions: Arc<Regions>,
) -> Tensor<2> {
    let [query, key, value] = [query, key, value].map(|t| t.into_dispatch());
    Tensor::from_dispatch(<Dispatch as SurfelOps>::gather(query, key, value, num_heads, regions))
}
