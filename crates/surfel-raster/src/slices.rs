//! Surfels as borrowed arrays going in and their gradients as owned arrays coming out.
//!
//! Same layout as [`surfel_core::Surfels`], so a framework can lend its tensors without a copy.
//! Invariant of checked slices: all arrays describe the same number of surfels.

use crate::RasterError;
use glam::{DVec2, DVec3};
use surfel_core::{Surfels, sh};

/// A surfel set that someone else owns; see [`Surfels`] for units and frames.
#[derive(Clone, Copy, Debug)]
pub struct SurfelSlices<'a> {
    /// Centres, world frame, scene units.
    pub centres: &'a [[f32; 3]],
    /// Standard deviations `[s_u, s_v]`, scene units.
    pub scales: &'a [[f32; 2]],
    /// `world_from_surfel` quaternions w x y z, of any length but zero.
    pub rotations: &'a [[f32; 4]],
    /// Opacity in (0, 1).
    pub opacities: &'a [f32],
    /// SH coefficients, coefficient-major: surfel `k`, coefficient `n` at `k * (degree + 1)² + n`.
    pub sh: &'a [[f32; 3]],
    /// SH degree 0..=3.
    pub sh_degree: usize,
}

impl<'a> From<&'a Surfels> for SurfelSlices<'a> {
    fn from(surfels: &'a Surfels) -> Self {
        Self {
            centres: &surfels.centres,
            scales: &surfels.scales,
            rotations: &surfels.rotations,
            opacities: &surfels.opacities,
            sh: &surfels.sh,
            sh_degree: surfels.sh_degree,
        }
    }
}

impl SurfelSlices<'_> {
    /// Number of surfels.
    pub fn len(&self) -> usize {
        self.centres.len()
    }

    /// True when there are none.
    pub fn is_empty(&self) -> bool {
        self.centres.is_empty()
    }

    /// SH coefficients per surfel and channel.
    pub fn num_coefficients(&self) -> usize {
        sh::num_coefficients(self.sh_degree)
    }

    /// # Errors
    /// [`RasterError`] when the degree is not supported or the arrays disagree in length.
    pub fn validate(&self) -> Result<(), RasterError> {
        if self.sh_degree > sh::MAX_DEGREE {
            return Err(RasterError::ShDegree(self.sh_degree));
        }
        let surfels = self.len();
        if u32::try_from(surfels).is_err() {
            return Err(RasterError::TooMany(surfels));
        }
        let lengths = [
            ("scales", self.scales.len(), surfels),
            ("rotations", self.rotations.len(), surfels),
            ("opacities", self.opacities.len(), surfels),
            ("sh", self.sh.len(), surfels * self.num_coefficients()),
        ];
        match lengths.into_iter().find(|&(_, found, expected)| found != expected) {
            Some((array, found, expected)) => Err(RasterError::Length { array, found, expected, surfels }),
            None => Ok(()),
        }
    }

    /// Shape of surfel `index`, widened.
    pub(crate) fn shape(&self, index: usize) -> SurfelShape {
        SurfelShape {
            centre: DVec3::from(self.centres[index].map(f64::from)),
            scales: DVec2::from(self.scales[index].map(f64::from)),
            rotation: self.rotations[index].map(f64::from),
            opacity: f64::from(self.opacities[index]),
        }
    }

    /// SH coefficients of surfel `index`.
    pub(crate) fn sh_of(&self, index: usize) -> &[[f32; 3]] {
        let n = self.num_coefficients();
        &self.sh[index * n..][..n]
    }
}

/// One surfel without its colour, in f64: what all per-surfel geometry works on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelShape {
    /// Centre, world frame.
    pub centre: DVec3,
    /// Standard deviations along the two tangents.
    pub scales: DVec2,
    /// `world_from_surfel` quaternion w x y z, of any length but zero.
    pub rotation: [f64; 4],
    /// Opacity in (0, 1).
    pub opacity: f64,
}

/// Gradients in the layout of the surfels; zero for surfels that were skipped or hidden.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfelGrads {
    /// Per centre, 1 / scene unit.
    pub centres: Vec<[f32; 3]>,
    /// Per `[s_u, s_v]`, 1 / scene unit.
    pub scales: Vec<[f32; 2]>,
    /// Per raw (un-normalised) quaternion w x y z.
    pub rotations: Vec<[f32; 4]>,
    /// Per opacity.
    pub opacities: Vec<f32>,
    /// Per SH coefficient, coefficient-major.
    pub sh: Vec<[f32; 3]>,
}
