//! The slow obvious twin of [`crate::surface`]: every pixel looks at every surfel, in f64.

use crate::config::{BoundingBox, MAX_ALPHA, MIN_ALPHA};
use crate::twin::{TwinScene, TwinSurfels};
use crate::{RasterError, RenderConfig};
use glam::DVec3;
use surfel_core::{Camera, Grid};

/// One pixel of [`crate::Surface`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfacePixel {
    /// z-depth; 0 where there is no median depth.
    pub depth: f64,
    /// Unit normal, camera frame.
    pub normal: [f64; 3],
    /// Smallest relative distance of any decision to tipping over.
    pub margin: f64,
}

/// The mean of the hits within `reach` (1 / scene unit) of the median depth.
///
/// # Errors
/// As [`crate::twin::render`].
pub fn surface(
    surfels: &TwinSurfels,
    camera: &Camera,
    config: &RenderConfig,
    reach: f64,
) -> Result<Grid<SurfacePixel>, RasterError> {
    let scene = TwinScene::new(surfels, camera, config)?;
    Ok(Grid::from_fn(camera.width, camera.height, |x, y| {
        let (blended, _, mut margin) = scene.blend(config, x, y);
        let Some(median) = blended.iter().rfind(|it| it.transmittance > 0.5).map(|it| it.z) else {
            return SurfacePixel { margin, ..SurfacePixel::default() };
        };
        let (mut weight, mut inverse, mut normal) = (0.0, 0.0, DVec3::ZERO);
        for it in &scene.splats {
            if config.bounding_box == BoundingBox::Reference && !it.offered_to(x as u32, y as u32) {
                continue;
            }
            let Some(hit) = it.projected.footprint.hit(x as f64, y as f64) else { continue };
            let at_centre = config.centre_depth_when_lowpass && !hit.surfel_wins();
            let z = if at_centre { it.projected.z } else { hit.z };
            let alpha = (it.opacity * (-0.5 * hit.rho()).exp()).min(MAX_ALPHA);
            margin = margin.min((alpha / MIN_ALPHA - 1.0).abs());
            if z < config.near_clip || z <= 0.0 || alpha < MIN_ALPHA {
                continue;
            }
            let apart = (1.0 / z - 1.0 / median).abs();
            margin = margin.min((apart / reach - 1.0).abs()).min((z / config.near_clip - 1.0).abs());
            margin = margin.min((hit.rho_surfel - hit.rho_lowpass).abs());
            if apart <= reach {
                weight += alpha;
                inverse += alpha / z;
                normal += alpha * it.projected.normal;
            }
        }
        SurfacePixel { depth: weight / inverse, normal: normal.normalize_or_zero().to_array(), margin }
    }))
}
