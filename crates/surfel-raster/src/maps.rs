//! The images a rendering makes, and the gradients a loss hands back for them.
//!
//! All maps are `width x height`, row-major. Invariant: where `alpha` is 0 every other map is 0, except
//! `colour`, which shows the background.

use crate::RasterError;
use surfel_core::Grid;

/// What the camera sees (spec 3.1, 3.5). Depths are z-depths in scene units, 0 where there is none.
#[derive(Clone, Debug, PartialEq)]
pub struct Maps {
    /// Blended colour including the background.
    pub colour: Grid<[f32; 3]>,
    /// Opacity, `1 - transmittance`.
    pub alpha: Grid<f32>,
    /// `sum w z`.
    pub depth_sum: Grid<f32>,
    /// `depth_sum / alpha`.
    pub depth_expected: Grid<f32>,
    /// z-depth of the surfel at which transmittance falls through one half, or of the last one blended.
    pub depth_median: Grid<f32>,
    /// `sum w n` in the camera frame (OpenCV axes), un-normalised; normals face the camera.
    pub normal: Grid<[f32; 3]>,
    /// `sum over pairs w_i w_j (m_i - m_j)²` of mapped depths (spec 3.4).
    pub distortion: Grid<f32>,
    /// Number of surfels blended.
    pub num_contributors: Grid<u32>,
}

/// Gradients of a loss with respect to [`Maps`]; `None` stands for zero.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapGrads {
    /// Per channel of `colour`.
    pub colour: Option<Grid<[f32; 3]>>,
    /// Per `alpha`.
    pub alpha: Option<Grid<f32>>,
    /// Per `depth_sum`.
    pub depth_sum: Option<Grid<f32>>,
    /// Per `depth_expected`; no gradient where alpha is 0.
    pub depth_expected: Option<Grid<f32>>,
    /// Per `depth_median`.
    pub depth_median: Option<Grid<f32>>,
    /// Per component of `normal`.
    pub normal: Option<Grid<[f32; 3]>>,
    /// Per `distortion`.
    pub distortion: Option<Grid<f32>>,
}

impl MapGrads {
    /// # Errors
    /// [`RasterError::GradientSize`] or [`RasterError::GradientValue`] for the first map of another size or with a
    /// value that is not finite.
    pub fn validate(&self, width: usize, height: usize) -> Result<(), RasterError> {
        check("colour", &self.colour, (width, height), |c| c.iter().all(|v| v.is_finite()))?;
        check("alpha", &self.alpha, (width, height), |v| v.is_finite())?;
        check("depth_sum", &self.depth_sum, (width, height), |v| v.is_finite())?;
        check("depth_expected", &self.depth_expected, (width, height), |v| v.is_finite())?;
        check("depth_median", &self.depth_median, (width, height), |v| v.is_finite())?;
        check("normal", &self.normal, (width, height), |n| n.iter().all(|v| v.is_finite()))?;
        check("distortion", &self.distortion, (width, height), |v| v.is_finite())
    }
}

fn check<T>(
    map: &'static str,
    grads: &Option<Grid<T>>,
    (width, height): (usize, usize),
    is_finite: impl Fn(&T) -> bool,
) -> Result<(), RasterError> {
    let Some(grid) = grads else { return Ok(()) };
    let (found_width, found_height) = (grid.width(), grid.height());
    if (found_width, found_height) != (width, height) {
        return Err(RasterError::GradientSize { map, found_width, found_height, width, height });
    }
    match grid.as_slice().iter().position(|value| !is_finite(value)) {
        Some(pixel) => Err(RasterError::GradientValue { map, x: pixel % width, y: pixel / width }),
        None => Ok(()),
    }
}
