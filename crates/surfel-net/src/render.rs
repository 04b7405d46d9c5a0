//! Surfels to pictures that gradients flow through: what training compares with photographs and depth.
//!
//! The rasterizer is [`surfel_raster`]; here it meets burn. Invariants: the maps are exactly the rasterizer's,
//! and whatever cannot be rendered is refused before anything is computed.

use crate::cost_volume::DepthRange;
use crate::head::SurfelTensors;
use crate::ops::render::{ALPHA, COLOUR, DEPTH_EXPECTED, DEPTH_MEDIAN, DISTORTION, NORMAL, RenderJob};
use crate::ops::render_planes;
use burn::tensor::Tensor;
use surfel_core::{Camera, sh};
use surfel_raster::pixel_camera::PixelCamera;
use surfel_raster::{RasterError, RenderConfig};

/// What a camera sees of surfels; see [`surfel_raster::Maps`].
#[derive(Clone, Debug)]
pub struct RenderedMaps {
    /// Blended colour with the background, `[3, height, width]`.
    pub colour: Tensor<3>,
    /// Opacity in \[0, 1), `[height, width]`.
    pub alpha: Tensor<2>,
    /// Mean z-depth of what is seen, scene units, 0 where alpha is 0, `[height, width]`.
    pub depth_expected: Tensor<2>,
    /// z-depth at which transmittance falls through one half, scene units, 0 for none, `[height, width]`.
    pub depth_median: Tensor<2>,
    /// Sum of weights times unit normals, so no longer than alpha; frame of this camera (OpenCV axes), facing it,
    /// `[3, height, width]`.
    pub normal: Tensor<3>,
    /// Weighted pairwise squared differences of depth, mapped by the config's range, `[height, width]`.
    pub distortion: Tensor<2>,
}

impl RenderedMaps {
    /// `(1 - ratio) * expected + ratio * median` depth (spec 3.5).
    pub fn surface_depth(&self, ratio: f64) -> Tensor<2> {
        self.depth_expected.clone() * (1.0 - ratio) + self.depth_median.clone() * ratio
    }
}

impl DepthRange {
    /// Render settings for a scene in this range: near clip and distortion follow it (spec 3.4), so that a scene
    /// in other units renders the same.
    pub fn render_config(&self) -> RenderConfig {
        RenderConfig::for_depth_range(self.near, self.far)
    }
}

/// Renders surfels; gradients flow to centres, scales, rotations, opacities and SH coefficients.
///
/// Broken or invisible surfels are skipped and get no gradient. A gradient that is not finite makes the gradients of
/// all surfels NaN.
///
/// # Errors
/// [`RasterError`] for tensors that disagree in size, a camera that cannot project, or a setting out of range.
pub fn render(surfels: &SurfelTensors, camera: &Camera, config: &RenderConfig) -> Result<RenderedMaps, RasterError> {
    check(surfels)?;
    config.validate()?;
    PixelCamera::new(camera)?;
    let planes = render_planes(surfels, RenderJob::new(*camera, *config, surfels.sh_degree));
    let size = [camera.height, camera.width];
    let vector = |range: std::ops::Range<usize>| planes.clone().narrow(0, range.start, range.len());
    let scalar = |index: usize| planes.clone().narrow(0, index, 1).reshape(size);
    Ok(RenderedMaps {
        colour: vector(COLOUR),
        alpha: scalar(ALPHA),
        depth_expected: scalar(DEPTH_EXPECTED),
        depth_median: scalar(DEPTH_MEDIAN),
        normal: vector(NORMAL),
        distortion: scalar(DISTORTION),
    })
}

fn check(tensors: &SurfelTensors) -> Result<(), RasterError> {
    if tensors.sh_degree > sh::MAX_DEGREE {
        return Err(RasterError::ShDegree(tensors.sh_degree));
    }
    let surfels = tensors.opacities.dims()[0];
    if u32::try_from(surfels).is_err() {
        return Err(RasterError::TooMany(surfels));
    }
    let num_coefficients = sh::num_coefficients(tensors.sh_degree);
    let shapes = [
        ("centres", tensors.centres.dims().to_vec(), vec![surfels, 3]),
        ("scales", tensors.scales.dims().to_vec(), vec![surfels, 2]),
        ("rotations", tensors.rotations.dims().to_vec(), vec![surfels, 4]),
        ("sh", tensors.sh.dims().to_vec(), vec![surfels, num_coefficients, 3]),
    ];
    match shapes.into_iter().find(|(_, found, expected)| found != expected) {
        Some((array, found, expected)) => Err(RasterError::Length {
            array,
            found: found.iter().product(),
            expected: expected.iter().product(),
            surfels,
        }),
        None => Ok(()),
    }
}
