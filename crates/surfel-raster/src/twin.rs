//! The slow obvious twin: every pixel looks at every surfel, in f64, formula by formula from spec 3.4.
//!
//! No tiles, no boxes, no early lists; what the fast path is tested against, and small enough to be
//! checked by eye. Its gradients pass finite differences because everything here is f64.

use crate::bounds::pixel_rect;
use crate::config::{BoundingBox, MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE};
use crate::pixel_camera::PixelCamera;
use crate::project::{Projected, project};
use crate::ray_splat::Hit;
use crate::sh_colour;
use crate::slices::SurfelShape;
pub use crate::twin_backward::backward;
pub use crate::twin_surface::{SurfacePixel, surface};
use crate::{RasterError, RenderConfig, SurfelSlices};
use surfel_core::{Camera, Grid};

/// A surfel set in f64.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TwinSurfels {
    /// Everything but colour.
    pub shapes: Vec<SurfelShape>,
    /// SH coefficients of each surfel.
    pub sh: Vec<Vec<[f64; 3]>>,
}

impl From<&SurfelSlices<'_>> for TwinSurfels {
    fn from(surfels: &SurfelSlices<'_>) -> Self {
        let widen = |index| surfels.sh_of(index).iter().map(|c| c.map(f64::from)).collect();
        Self {
            shapes: (0..surfels.len()).map(|index| surfels.shape(index)).collect(),
            sh: (0..surfels.len()).map(widen).collect(),
        }
    }
}

/// One pixel of every map of [`crate::Maps`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TwinPixel {
    /// Colour including the background.
    pub colour: [f64; 3],
    /// `1 - transmittance`.
    pub alpha: f64,
    /// `sum w z`.
    pub depth_sum: f64,
    /// Median z-depth, 0 for none.
    pub depth_median: f64,
    /// `sum w n`, camera frame.
    pub normal: [f64; 3],
    /// Pairwise squared differences of mapped depths.
    pub distortion: f64,
    /// Number of surfels blended.
    pub num_contributors: u32,
    /// Smallest distance of any decision (skip, stop, median, which branch) to tipping over, relative: pixels
    /// with a small margin may differ from a rendering in other precision.
    pub margin: f64,
}

impl TwinPixel {
    /// `depth_sum / alpha`, 0 where alpha is 0.
    pub fn depth_expected(&self) -> f64 {
        if self.alpha > 0.0 { self.depth_sum / self.alpha } else { 0.0 }
    }
}

/// A surfel ready for blending.
pub(crate) struct TwinSplat {
    pub index: usize,
    pub opacity: f64,
    pub projected: Projected,
    pub colour: [f64; 3],
    rect: Option<crate::bounds::PixelRect>,
}

/// One surfel as one pixel blends it.
pub(crate) struct Blended {
    pub splat: usize,
    pub hit: Hit,
    pub z: f64,
    pub gauss: f64,
    pub alpha: f64,
    pub transmittance: f64,
}

/// A prepared scene.
pub(crate) struct TwinScene {
    pub camera: PixelCamera,
    pub splats: Vec<TwinSplat>,
}

impl TwinScene {
    pub fn new(surfels: &TwinSurfels, camera: &Camera, config: &RenderConfig) -> Result<Self, RasterError> {
        config.validate()?;
        let camera = PixelCamera::new(camera)?;
        let mut splats: Vec<TwinSplat> = surfels
            .shapes
            .iter()
            .zip(&surfels.sh)
            .enumerate()
            .filter_map(|(index, (shape, sh))| {
                let projected = project(&camera, config, shape)?;
                let colour = sh_colour::colour(sh, projected.direction)?;
                let rect = pixel_rect(&camera, config, &projected.footprint, shape.opacity);
                Some(TwinSplat { index, opacity: shape.opacity, projected, colour, rect })
            })
            .collect();
        splats.sort_by(|a, b| a.projected.depth_key().total_cmp(&b.projected.depth_key()));
        Ok(Self { camera, splats })
    }

    /// The surfels pixel `(x, y)` blends, front to back, its final transmittance, and its margin.
    pub fn blend(&self, config: &RenderConfig, x: usize, y: usize) -> (Vec<Blended>, f64, f64) {
        let mut blended = Vec::new();
        let mut transmittance = 1.0;
        let mut margin = f64::INFINITY;
        for (splat, it) in self.splats.iter().enumerate() {
            if config.bounding_box == BoundingBox::Reference && !it.offered_to(x as u32, y as u32) {
                continue;
            }
            let Some(hit) = it.projected.footprint.hit(x as f64, y as f64) else { continue };
            let at_centre = config.centre_depth_when_lowpass && !hit.surfel_wins();
            let z = if at_centre { it.projected.z } else { hit.z };
            let gauss = (-0.5 * hit.rho()).exp();
            let alpha = (it.opacity * gauss).min(MAX_ALPHA);
            if alpha >= MIN_ALPHA {
                margin = margin.min((z / config.near_clip - 1.0).abs());
            }
            if z < config.near_clip || z <= 0.0 {
                continue;
            }
            margin = margin.min((alpha / MIN_ALPHA - 1.0).abs());
            if alpha < MIN_ALPHA {
                continue;
            }
            margin = margin.min((hit.rho_surfel - hit.rho_lowpass).abs());
            let after = transmittance * (1.0 - alpha);
            margin = margin.min((after / MIN_TRANSMITTANCE - 1.0).abs()).min((transmittance / 0.5 - 1.0).abs());
            if after < MIN_TRANSMITTANCE {
                break;
            }
            blended.push(Blended { splat, hit, z, gauss, alpha, transmittance });
            transmittance = after;
        }
        (blended, transmittance, margin)
    }
}

impl TwinSplat {
    pub(crate) fn offered_to(&self, x: u32, y: u32) -> bool {
        self.rect.is_some_and(|r| r.x0 <= x && x < r.x1 && r.y0 <= y && y < r.y1)
    }
}

/// Renders by brute force; the same skips and settings as [`crate::render`].
///
/// # Errors
/// [`RasterError`] for a camera that cannot project or a setting out of range.
pub fn render(surfels: &TwinSurfels, camera: &Camera, config: &RenderConfig) -> Result<Grid<TwinPixel>, RasterError> {
    let scene = TwinScene::new(surfels, camera, config)?;
    Ok(Grid::from_fn(camera.width, camera.height, |x, y| {
        let (blended, transmittance, margin) = scene.blend(config, x, y);
        pixel(&scene, config, &blended, transmittance, margin)
    }))
}

fn pixel(scene: &TwinScene, config: &RenderConfig, blended: &[Blended], transmittance: f64, margin: f64) -> TwinPixel {
    let mut out = TwinPixel {
        colour: config.background.map(|c| transmittance * f64::from(c)),
        alpha: 1.0 - transmittance,
        num_contributors: blended.len() as u32,
        margin,
        ..TwinPixel::default()
    };
    for (i, it) in blended.iter().enumerate() {
        let splat = &scene.splats[it.splat];
        let w = it.alpha * it.transmittance;
        for channel in 0..3 {
            out.colour[channel] += w * splat.colour[channel];
            out.normal[channel] += w * splat.projected.normal[channel];
        }
        out.depth_sum += w * it.z;
        if it.transmittance > 0.5 {
            out.depth_median = it.z;
        }
        for other in &blended[..i] {
            let difference = mapped_depth(config, it.z) - mapped_depth(config, other.z);
            out.distortion += w * other.alpha * other.transmittance * difference * difference;
        }
    }
    out
}

/// `m` of the distortion (spec 3.4).
pub(crate) fn mapped_depth(config: &RenderConfig, z: f64) -> f64 {
    config.dist_far / (config.dist_far - config.dist_near) * (1.0 - config.dist_near / z)
}
