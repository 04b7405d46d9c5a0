//! Depth, normal, alpha and colour maps of the surfels, seen from the cameras of the photographs.
//!
//! Depth is that of the surface which the surfels sample, not of the first of them: two views' surfels lie a little
//! before and behind each other, and what blending meets first is too near by about the noise.
//! Fifth step of the road: what is fused and written is what the surfels show, not what was estimated.
//! Invariant: a map is empty (0) exactly where no surfel reaches the pixel or the photograph is masked.

use surfel_core::{Grid, Surfels, View};
use surfel_raster::{RasterError, RenderConfig, SurfelSlices, forward, surface};

/// What one camera sees of the surfels.
#[derive(Clone, Debug)]
pub struct ViewMaps {
    /// z-depth of the surface, unit of the cameras; 0 = none.
    pub depth: Grid<f32>,
    /// Unit normals, camera frame, facing the camera; zero = none.
    pub normal: Grid<[f32; 3]>,
    /// Opacity.
    pub alpha: Grid<f32>,
    /// sRGB blended over black.
    pub colour: Grid<[f32; 3]>,
}

/// Surfels this close in depth are samples of one surface, in steps (about a pixel of parallax each).
const REACH_STEPS: f64 = 1.5;

/// Renders the surfels from every view; `ranges` are near and far per view, `steps` the inverse depth of a step.
///
/// # Errors
/// [`RasterError`] for a camera or a range that cannot be rendered.
pub fn render_views(
    surfels: &Surfels,
    views: &[View],
    ranges: &[(f64, f64)],
    steps: &[f32],
) -> Result<Vec<ViewMaps>, RasterError> {
    let slices = SurfelSlices::from(surfels);
    let inputs = views.iter().zip(ranges).zip(steps);
    inputs
        .map(|((view, &(near, far)), step)| {
            // The hit of a ray with an edge-on disc runs away; its centre does not.
            let config = RenderConfig { centre_depth_when_lowpass: true, ..RenderConfig::for_depth_range(near, far) };
            let (maps, tape) = forward(&slices, &view.camera, &config)?;
            let surface = surface(&tape, &maps.depth_median, REACH_STEPS * f64::from(*step));
            let seen = |x: usize, y: usize| view.valid[(x, y)] && maps.depth_median[(x, y)] > 0.0;
            let (width, height) = (view.camera.width, view.camera.height);
            Ok(ViewMaps {
                depth: Grid::from_fn(width, height, |x, y| if seen(x, y) { surface.depth[(x, y)] } else { 0.0 }),
                normal: Grid::from_fn(width, height, |x, y| if seen(x, y) { surface.normal[(x, y)] } else { [0.0; 3] }),
                alpha: Grid::from_fn(width, height, |x, y| if seen(x, y) { maps.alpha[(x, y)] } else { 0.0 }),
                colour: maps.colour,
            })
        })
        .collect()
}
