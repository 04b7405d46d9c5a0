//! Joins the rasterizer to burn: one trait, a CPU implementation on Flex, the backward pass once.
//!
//! A backend on another device implements the two functions by moving its tensors here, calling the same
//! [`RenderJob`], and moving the results back. Invariant: no gradient flows to the camera.

use super::join::flex;
use super::render::{NUM_PLANES, Parameters, RenderJob};
use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, TensorMetadata, backend_extension};
use burn::tensor::Tensor;
use burn_flex::FlexTensor;
use std::sync::Arc;

/// Why the jobs below may be expected to succeed: `crate::render::render` refuses all others.
const CHECKED: &str = "surfels, camera and settings were checked before the rendering was queued";

/// Rendering on a backend's own tensors, shaped as in [`crate::SurfelTensors`].
#[backend_extension(Flex, Autodiff)]
pub trait RenderOps: Backend {
    /// See [`RenderJob::forward`].
    fn render(
        centres: FloatTensor<Self>,
        scales: FloatTensor<Self>,
        rotations: FloatTensor<Self>,
        opacities: FloatTensor<Self>,
        sh: FloatTensor<Self>,
        job: Arc<RenderJob>,
    ) -> FloatTensor<Self>;
    /// See [`RenderJob::backward`]: the gradients of the first five.
    fn render_backward(
        centres: FloatTensor<Self>,
        scales: FloatTensor<Self>,
        rotations: FloatTensor<Self>,
        opacities: FloatTensor<Self>,
        sh: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        job: Arc<RenderJob>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>);
}

fn parameters([centres, scales, rotations, opacities, sh]: &[FlexTensor; 5]) -> Parameters<'_> {
    Parameters {
        centres: centres.storage(),
        scales: scales.storage(),
        rotations: rotations.storage(),
        opacities: opacities.storage(),
        sh: sh.storage(),
    }
}

impl RenderOps for Flex {
    fn render(
        centres: FloatTensor<Self>,
        scales: FloatTensor<Self>,
        rotations: FloatTensor<Self>,
        opacities: FloatTensor<Self>,
        sh: FloatTensor<Self>,
        job: Arc<RenderJob>,
    ) -> FloatTensor<Self> {
        let surfels = [centres, scales, rotations, opacities, sh].map(|t| t.to_contiguous());
        let planes = job.forward(&parameters(&surfels)).expect(CHECKED);
        flex(planes, [NUM_PLANES, job.camera.height, job.camera.width])
    }

    fn render_backward(
        centres: FloatTensor<Self>,
        scales: FloatTensor<Self>,
        rotations: FloatTensor<Self>,
        opacities: FloatTensor<Self>,
        sh: FloatTensor<Self>,
        grad: FloatTensor<Self>,
        job: Arc<RenderJob>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
        let surfels = [centres, scales, rotations, opacities, sh].map(|t| t.to_contiguous());
        let grads = job.backward(&parameters(&surfels), grad.to_contiguous().storage()).expect(CHECKED);
        let [centres, scales, rotations, opacities, sh] = surfels.map(|t| t.shape());
        (
            flex(grads.centres.into_flattened(), centres),
            flex(grads.scales.into_flattened(), scales),
            flex(grads.rotations.into_flattened(), rotations),
            flex(grads.opacities, opacities),
            flex(grads.sh.into_flattened(), sh),
        )
    }
}

impl<B: Backend + RenderOps, C: CheckpointStrategy> RenderOps for Autodiff<B, C> {
    fn render(
        centres: FloatTensor<Self>,
        scales: FloatTensor<Self>,
        rotations: FloatTensor<Self>,
        opacities: FloatTensor<Self>,
        sh: FloatTensor<Self>,
        job: Arc<RenderJob>,
    ) -> FloatTensor<Self> {
        #[derive(Debug)]
        struct RenderBackward;
        impl<B: Backend + RenderOps> Backward<B, 5> for RenderBackward {
            type State = ([FloatTensor<B>; 5], Arc<RenderJob>);
            fn backward(self, ops: Ops<Self::State, 5>, grads: &mut Gradients, _: &mut Checkpointer) {
                let grad = grads.consume::<B>(&ops.node);
                let ([centres, scales, rotations, opacities, sh], job) = ops.state;
                let (centres, scales, rotations, opacities, sh) =
                    B::render_backward(centres, scales, rotations, opacities, sh, grad, job);
                for (parent, grad) in ops.parents.into_iter().zip([centres, scales, rotations, opacities, sh]) {
                    if let Some(parent) = parent {
                        grads.register::<B>(parent.id, grad);
                    }
                }
            }
        }
        let [(centres, a), (scales, b), (rotations, c), (opacities, d), (sh, e)] =
            [centres, scales, rotations, opacities, sh].map(|t| t.into_parts());
        match RenderBackward.prepare::<C>([a, b, c, d, e]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let kept = [&centres, &scales, &rotations, &opacities, &sh].map(Clone::clone);
                let picture = B::render(centres, scales, rotations, opacities, sh, job.clone());
                prep.finish((kept, job), picture)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::render(centres, scales, rotations, opacities, sh, job)),
        }
    }

    fn render_backward(
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: FloatTensor<Self>,
        _: Arc<RenderJob>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>, FloatTensor<Self>) {
        panic!("rendering has no second derivatives: a gradient of it cannot be differentiated again")
    }
}

/// The packed picture `[NUM_PLANES, height, width]` of surfels that were checked to be renderable.
pub(crate) fn render_planes(surfels: &crate::SurfelTensors, job: RenderJob) -> Tensor<3> {
    let surfels = surfels.clone();
    Tensor::from_dispatch(<Dispatch as RenderOps>::render(
        surfels.centres.into_dispatch(),
        surfels.scales.into_dispatch(),
        surfels.rotations.into_dispatch(),
        surfels.opacities.into_dispatch(),
        surfels.sh.into_dispatch(),
        Arc::new(job),
    ))
}
