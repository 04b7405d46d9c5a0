//! What a person may choose about a reconstruction; everything left `None` is chosen from the data and reported.

use crate::reconstruct::surfels::SurfelConfig;
use surfel_io::scene::FormatKind;
use surfel_stereo::MatchConfig;

/// Choices of one reconstruction. Lengths are in scene units.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Names, stems or numbers of the photographs to use; empty = choose.
    pub views: Vec<String>,
    /// How many photographs to choose when none is named (at least 2).
    pub num_views: Option<usize>,
    /// Working width and height in pixels.
    pub size: Option<(usize, usize)>,
    /// The format of the cameras, when detection should not decide.
    pub format: Option<FormatKind>,
    /// Nearest z-depth.
    pub near: Option<f64>,
    /// Farthest z-depth.
    pub far: Option<f64>,
    /// Edge of a voxel of the mesh.
    pub voxel: Option<f64>,
    /// Components of the mesh to keep.
    pub keep_components: Option<usize>,
    /// Go on although the cameras contradict the photographs.
    pub trust_cameras: bool,
    /// Matching.
    pub matching: MatchConfig,
    /// Surfels.
    pub surfels: SurfelConfig,
}
