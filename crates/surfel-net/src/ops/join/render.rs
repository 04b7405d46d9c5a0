//! The rasterizer as a kernel that burn differentiates through.
//!
//! Invariant: no gradient flows to the camera.

use crate::SurfelTensors;
use crate::ops::kernel::{Kernel, SLOTS, run};
use crate::ops::render::{NUM_PLANES, Parameters, RenderJob};
use burn::tensor::Tensor;

/// Why the jobs below may be expected to succeed: `crate::render::render` refuses all others.
const CHECKED: &str = "surfels, camera and settings were checked before the rendering was queued";

fn parameters<'a>(inputs: &[&'a [f32]; SLOTS]) -> Parameters<'a> {
    let [centres, scales, rotations, opacities, sh] = *inputs;
    Parameters { centres, scales, rotations, opacities, sh }
}

/// Inputs are centres, scales, rotations, opacities and SH coefficients, shaped as in [`SurfelTensors`].
impl Kernel for RenderJob {
    fn shape(&self) -> Vec<usize> {
        vec![NUM_PLANES, self.camera.height, self.camera.width]
    }

    fn forward(&self, inputs: &[&[f32]; SLOTS]) -> Vec<f32> {
        RenderJob::forward(self, &parameters(inputs)).expect(CHECKED)
    }

    fn backward(&self, inputs: &[&[f32]; SLOTS], grad: &[f32], _: [bool; SLOTS]) -> [Option<Vec<f32>>; SLOTS] {
        // All five come of the same pass.
        let grads = RenderJob::backward(self, &parameters(inputs), grad).expect(CHECKED);
        [
            grads.centres.into_flattened(),
            grads.scales.into_flattened(),
            grads.rotations.into_flattened(),
            grads.opacities,
            grads.sh.into_flattened(),
        ]
        .map(Some)
    }
}

/// The packed picture `[NUM_PLANES, height, width]` of surfels that were checked to be renderable.
pub(crate) fn render_planes(surfels: &SurfelTensors, job: RenderJob) -> Tensor<3> {
    let device = surfels.centres.device();
    let SurfelTensors { centres, scales, rotations, opacities, sh, .. } = surfels.clone();
    let [centres, scales, rotations] = [centres, scales, rotations].map(Tensor::into_dispatch);
    run(&device, [centres, scales, rotations, opacities.into_dispatch(), sh.into_dispatch()], job)
}
