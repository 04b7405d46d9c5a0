//! Our kernels for tensors of a graphics card: its own where there is one (`ops/card`), else to the CPU, through the
//! same code, and back.
//!
//! Normalisation and attention within a view use burn's own operators there (`runs_on`); what comes here is what burn
//! lacks. Invariant: what has no kernel for cards has the results of the CPU, to the last bit.

use super::{Kernel, KernelOps, SLOTS};
use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn::tensor::TensorData;
use burn_cubecl::CubeBackend;
use std::sync::Arc;

/// Why tensors may be expected to arrive: a card that fails here has lost the run anyway, and burn itself panics.
const ARRIVES: &str = "the device gives its tensors back";

/// The values of a tensor, row-major.
fn fetched(tensor: FloatTensor<CubeBackend>) -> Vec<f32> {
    let data = burn::tensor::read_sync(CubeBackend::float_into_data(tensor)).expect(ARRIVES);
    data.convert::<f32>().try_to_vec().expect(ARRIVES)
}

impl KernelOps for CubeBackend {
    fn kernel(
        a: FloatTensor<Self>,
        b: FloatTensor<Self>,
        c: FloatTensor<Self>,
        d: FloatTensor<Self>,
        e: FloatTensor<Self>,
        kernel: Arc<dyn Kernel>,
    ) -> FloatTensor<Self> {
        let device = a.device.clone();
        let inputs = [a, b, c, d, e];
        if let Some(output) = kernel.on_card(&inputs) {
            return output;
        }
        let inputs = inputs.map(fetched);
        let output = kernel.forward(&inputs.each_ref().map(Vec::as_slice));
        Self::float_from_data(TensorData::new(output, kernel.shape()), &device)
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
        let device = a.device.clone();
        let inputs = [a, b, c, d, e];
        if let Some(grads) = kernel.gradients_on_card(&inputs, &grad, wanted) {
            return grads.into();
        }
        let shapes = inputs.each_ref().map(|tensor| tensor.meta.shape().clone());
        let inputs = inputs.map(fetched);
        let grads = kernel.backward(&inputs.each_ref().map(Vec::as_slice), &fetched(grad), wanted);
        let uploaded = |(grad, shape): (Option<Vec<f32>>, _)| {
            grad.map(|grad| Self::float_from_data(TensorData::new(grad, shape), &device))
        };
        grads.into_iter().zip(shapes).map(uploaded).collect()
    }
}
