//! Surfels as tensors that gradients flow through.

use crate::layers::values;
use burn::tensor::Tensor;
use surfel_core::Surfels;

/// One surfel per pixel of each view, view-major then row-major; world frame, scene units.
#[derive(Clone, Debug)]
pub struct SurfelTensors {
    /// Centres, `[surfels, 3]`.
    pub centres: Tensor<2>,
    /// Standard deviations, `[surfels, 2]`.
    pub scales: Tensor<2>,
    /// Unit `world_from_surfel` quaternions w x y z, `[surfels, 4]`.
    pub rotations: Tensor<2>,
    /// Opacities in (0, 1), `[surfels]`.
    pub opacities: Tensor<1>,
    /// SH coefficients, `[surfels, coefficients, 3]`.
    pub sh: Tensor<3>,
    /// Degree of the SH coefficients.
    pub sh_degree: usize,
}

impl SurfelTensors {
    /// The values, without gradients.
    pub fn to_surfels(&self) -> Surfels {
        Surfels {
            centres: rows(values(self.centres.clone())),
            scales: rows(values(self.scales.clone())),
            rotations: rows(values(self.rotations.clone())),
            opacities: values(self.opacities.clone()),
            sh: rows(values(self.sh.clone())),
            sh_degree: self.sh_degree,
        }
    }
}

fn rows<const N: usize>(values: Vec<f32>) -> Vec<[f32; N]> {
    values.as_chunks().0.to_vec()
}
