//! The surface that several depth maps agree on, without its floaters.
//!
//! Sixth step of the road; `surfel-mesh` does the work, this file says what the road asks of it.
//! Invariant: where no map has depth there is an empty mesh, not an error.

use surfel_core::{Grid, TriMesh, View};
use surfel_mesh::{ComponentReport, DepthView, MeshConfig, MeshError, MeshReport, TsdfConfig, mesh_from_views};

/// An island of surface smaller than one triangle per this many solid pixels (about 0.1 % of them) is a floater.
const PIXELS_PER_ISLAND_TRIANGLE: usize = 500;

/// What may be chosen about a mesh; `None` is chosen from the depth maps.
#[derive(Clone, Copy, Debug, Default)]
pub struct MeshChoice {
    /// Edge of a voxel, unit of the cameras.
    pub voxel: Option<f64>,
    /// Components to keep.
    pub keep_components: Option<usize>,
}

/// Fuses one depth map per view (z-depth, 0 = none), coloured by the photographs; frame and unit of the cameras.
///
/// # Errors
/// Those of [`mesh_from_views`], but [`MeshError::NoDepth`].
pub fn mesh_from_depth(
    views: &[View],
    depths: &[Grid<f32>],
    choice: MeshChoice,
) -> Result<(TriMesh, MeshReport), MeshError> {
    let num_solid: usize = depths.iter().map(|depth| depth.as_slice().iter().filter(|&&z| z > 0.0).count()).sum();
    let depth_views: Vec<DepthView> = views
        .iter()
        .zip(depths)
        .map(|(view, depth)| DepthView { camera: &view.camera, depth, colour: &view.image, weight: None })
        .collect();
    let ours = MeshConfig::default();
    let config = MeshConfig {
        min_triangles: ours.min_triangles.max(num_solid / PIXELS_PER_ISLAND_TRIANGLE),
        tsdf: choice.voxel.map(TsdfConfig::uniform),
        keep: choice.keep_components.unwrap_or(ours.keep),
        ..ours
    };
    match mesh_from_views(&depth_views, &config) {
        Err(MeshError::NoDepth { .. }) => Ok((TriMesh::default(), nothing_fused())),
        result => result,
    }
}

fn nothing_fused() -> MeshReport {
    MeshReport {
        masks: Vec::new(),
        tsdf: TsdfConfig::uniform(1.0),
        cut_pixels: 0,
        num_blocks: 0,
        num_bytes: 0,
        extracted_triangles: 0,
        components: ComponentReport::default(),
    }
}
