//! Depth, normal, alpha and colour maps of the surfels, seen from the cameras of the photographs.
//!
//! Fifth step of the road: what is fused and written is what the surfels show, not what was estimated.
//! Invariant: a map is empty (0) exactly where no surfel reaches the pixel or the photograph is masked.

use surfel_core::{Grid, Surfels, View};
use surfel_raster::{RasterError, RenderConfig, SurfelSlices, render};

/// What one camera sees of the surfels.
#[derive(Clone, Debug)]
pub struct ViewMaps {
    /// Median z-depth, unit of the cameras; 0 = none.
    pub depth: Grid<f32>,
    /// Unit normals, camera frame, facing the camera; zero = none.
    pub normal: Grid<[f32; 3]>,
    /// Opacity.
    pub alpha: Grid<f32>,
    /// sRGB blended over black.
    pub colour: Grid<[f32; 3]>,
}

/// Renders the surfels from every view; `ranges` are near and far per view.
pub fn render_views(surfels: &Surfels, views: &[View], ranges: &[(f64, f64)]) -> Result<Vec<ViewMaps>, RasterError> {
    let slices = SurfelSlices::from(surfels);
    views
        .iter()
        .zip(ranges)
        .map(|(view, &(near, far))| {
            // The hit of a ray with an edge-on disc runs away; its centre does not.
            let config = RenderConfig { centre_depth_when_lowpass: true, ..RenderConfig::for_depth_range(near, far) };
            let maps = render(&slices, &view.camera, &config)?;
            let seen = |x: usize, y: usize| view.valid[(x, y)] && maps.depth_median[(x, y)] > 0.0;
            let (width, height) = (view.camera.width, view.camera.height);
            Ok(ViewMaps {
                depth: Grid::from_fn(width, height, |x, y| if seen(x, y) { maps.depth_median[(x, y)] } else { 0.0 }),
                normal: Grid::from_fn(width, height, |x, y| {
                    if seen(x, y) { normalised(maps.normal[(x, y)]) } else { [0.0; 3] }
                }),
                alpha: Grid::from_fn(width, height, |x, y| if seen(x, y) { maps.alpha[(x, y)] } else { 0.0 }),
                colour: maps.colour,
            })
        })
        .collect()
}

fn normalised(n: [f32; 3]) -> [f32; 3] {
    glam::Vec3::from(n).normalize_or(glam::Vec3::NEG_Z).to_array()
}
