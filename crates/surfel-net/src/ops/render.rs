//! Rendering as an operator: flat surfel arrays to one packed picture of all maps, and gradients back.
//!
//! Packs the maps of [`surfel_raster`] plane after plane, so that a framework sees one output with one gradient.
//! Invariant: numbers are those of [`surfel_raster::forward`] and [`surfel_raster::backward`], only reordered.

use std::ops::Range;
use std::sync::OnceLock;
use surfel_core::{Camera, Grid};
use surfel_raster::{MapGrads, Maps, RasterError, RenderConfig, SurfelGrads, SurfelSlices, Tape};

/// Planes of a packed picture.
pub const NUM_PLANES: usize = 10;
/// Red, green, blue.
pub const COLOUR: Range<usize> = 0..3;
/// Opacity.
pub const ALPHA: usize = 3;
/// Expected z-depth.
pub const DEPTH_EXPECTED: usize = 4;
/// Median z-depth.
pub const DEPTH_MEDIAN: usize = 5;
/// Blended normal, x y z.
pub const NORMAL: Range<usize> = 6..9;
/// Distortion.
pub const DISTORTION: usize = 9;

/// Surfels as row-major flat arrays; see [`crate::SurfelTensors`] for shapes, units and frames.
#[derive(Clone, Copy, Debug)]
pub struct Parameters<'a> {
    /// 3 per surfel.
    pub centres: &'a [f32],
    /// 2 per surfel.
    pub scales: &'a [f32],
    /// 4 per surfel, w x y z.
    pub rotations: &'a [f32],
    /// 1 per surfel.
    pub opacities: &'a [f32],
    /// 3 per coefficient, coefficients of a surfel together.
    pub sh: &'a [f32],
}

impl<'a> Parameters<'a> {
    fn slices(&self, sh_degree: usize) -> SurfelSlices<'a> {
        SurfelSlices {
            centres: self.centres.as_chunks().0,
            scales: self.scales.as_chunks().0,
            rotations: self.rotations.as_chunks().0,
            opacities: self.opacities,
            sh: self.sh.as_chunks().0,
            sh_degree,
        }
    }
}

/// One rendering to do, and what its gradient needs to remember of it.
#[derive(Debug)]
pub struct RenderJob {
    /// The eye; no gradient flows to it.
    pub camera: Camera,
    /// How to render.
    pub config: RenderConfig,
    /// Degree of the SH coefficients.
    pub sh_degree: usize,
    tape: OnceLock<Tape>,
}

impl RenderJob {
    /// A rendering not yet done.
    pub fn new(camera: Camera, config: RenderConfig, sh_degree: usize) -> Self {
        Self { camera, config, sh_degree, tape: OnceLock::new() }
    }

    /// The picture `[NUM_PLANES, height, width]`; remembers the first one for [`Self::backward`].
    ///
    /// # Errors
    /// As [`surfel_raster::forward`].
    pub fn forward(&self, surfels: &Parameters) -> Result<Vec<f32>, RasterError> {
        let (maps, tape) = surfel_raster::forward(&surfels.slices(self.sh_degree), &self.camera, &self.config)?;
        // A job is done once; were it done again, the gradient of the first would still be right for equal surfels.
        let _ = self.tape.set(tape);
        Ok(packed(&maps))
    }

    /// Gradients of the surfels, from that of the picture. A gradient that is not finite comes from a loss that
    /// went wrong and makes all of them NaN, as any other operator would, for the training loop to notice.
    ///
    /// # Errors
    /// As [`surfel_raster::backward`].
    pub fn backward(&self, surfels: &Parameters, grad: &[f32]) -> Result<SurfelGrads, RasterError> {
        let slices = surfels.slices(self.sh_degree);
        let again;
        let tape = match self.tape.get() {
            Some(tape) => tape,
            None => {
                again = surfel_raster::forward(&slices, &self.camera, &self.config)?.1;
                &again
            }
        };
        match surfel_raster::backward(&slices, tape, &unpacked(grad, self.camera.width, self.camera.height)) {
            Err(RasterError::GradientValue { .. }) => Ok(poisoned(&slices)),
            grads => grads,
        }
    }
}

fn packed(maps: &Maps) -> Vec<f32> {
    let mut planes = Vec::with_capacity(NUM_PLANES * maps.alpha.len());
    let channels = |planes: &mut Vec<f32>, map: &Grid<[f32; 3]>| {
        (0..3).for_each(|c| planes.extend(map.as_slice().iter().map(|pixel| pixel[c])));
    };
    channels(&mut planes, &maps.colour);
    planes.extend(maps.alpha.as_slice());
    planes.extend(maps.depth_expected.as_slice());
    planes.extend(maps.depth_median.as_slice());
    channels(&mut planes, &maps.normal);
    planes.extend(maps.distortion.as_slice());
    planes
}

fn unpacked(planes: &[f32], width: usize, height: usize) -> MapGrads {
    let len = width * height;
    let plane = |index: usize| &planes[index * len..][..len];
    let scalar = |index| Some(Grid::from_vec(width, height, plane(index).to_vec()));
    let vector = |planes: Range<usize>| {
        let [x, y, z] = [0, 1, 2].map(|c| plane(planes.start + c));
        let pixels = x.iter().zip(y).zip(z).map(|((&x, &y), &z)| [x, y, z]).collect();
        Some(Grid::from_vec(width, height, pixels))
    };
    MapGrads {
        colour: vector(COLOUR),
        alpha: scalar(ALPHA),
        depth_sum: None,
        depth_expected: scalar(DEPTH_EXPECTED),
        depth_median: scalar(DEPTH_MEDIAN),
        normal: vector(NORMAL),
        distortion: scalar(DISTORTION),
    }
}

fn poisoned(surfels: &SurfelSlices) -> SurfelGrads {
    SurfelGrads {
        centres: vec![[f32::NAN; 3]; surfels.len()],
        scales: vec![[f32::NAN; 2]; surfels.len()],
        rotations: vec![[f32::NAN; 4]; surfels.len()],
        opacities: vec![f32::NAN; surfels.len()],
        sh: vec![[f32::NAN; 3]; surfels.sh.len()],
    }
}
