//! The plane sweep as a kernel that burn differentiates through.
//!
//! Invariant: no gradient flows to poses or candidates.

#[cfg(any(feature = "cuda", feature = "wgpu"))]
use crate::ops::card::{self, OnCard};
use crate::ops::count;
use crate::ops::kernel::{Kernel, SLOTS, run};
use crate::ops::plane_sweep::{self as sweep, Sweep};
use burn::tensor::Tensor;
use std::sync::Arc;

/// What is no feature; features `[views, height, width, channels]` are its only input.
#[derive(Debug)]
struct Correlation {
    channels: usize,
    geometry: Arc<Sweep>,
}

impl Kernel for Correlation {
    fn shape(&self) -> Vec<usize> {
        let Sweep { height, width, .. } = *self.geometry;
        vec![self.geometry.num_views(), height, self.geometry.num_candidates(), width]
    }

    fn forward(&self, inputs: &[&[f32]; SLOTS]) -> Vec<f32> {
        sweep::forward(inputs[0], self.channels, &self.geometry)
    }

    fn backward(&self, inputs: &[&[f32]; SLOTS], grad: &[f32], _: [bool; SLOTS]) -> [Option<Vec<f32>>; SLOTS] {
        [Some(sweep::backward(inputs[0], self.channels, &self.geometry, grad)), None, None, None, None]
    }

    #[cfg(any(feature = "cuda", feature = "wgpu"))]
    fn on_card(&self, inputs: &[OnCard; SLOTS]) -> Option<OnCard> {
        Some(card::sweep(&inputs[0], self.channels, &self.geometry))
    }
}

/// Plane-sweep correlation `[views, candidates, height, width]` of features `[views, channels, height, width]`.
pub fn plane_sweep(features: Tensor<4>, geometry: Arc<Sweep>) -> Tensor<4> {
    let device = features.device();
    let kernel = Correlation { channels: features.dims()[1], geometry: geometry.clone() };
    // One dot product per sample; the blending of four cells is left out, as for any sampling.
    let neighbours = geometry.warps.iter().map(Vec::len).sum::<usize>();
    let Sweep { height, width, .. } = *geometry;
    count::tell_product(&[neighbours, geometry.num_candidates(), height, width, kernel.channels]);
    let features = features.permute([0, 2, 3, 1]).into_dispatch();
    let volume: Tensor<4> = run(&device, [features], kernel);
    volume.permute([0, 2, 1, 3])
}
