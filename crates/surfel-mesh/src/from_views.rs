//! The facade: depth maps in, cleaned mesh and a full account out.
//!
//! Masks, fuses, extracts and filters in the order of spec 6.2. Invariant: every number that was chosen and
//! every pixel, component and triangle that was removed stands in the [`MeshReport`].

use crate::{
    ComponentReport, DepthView, MaskConfig, MaskCounts, MeshError, TsdfConfig, facing, filter_components, fuse,
    mask_unreliable, normals_to_the_rim,
};
use surfel_core::{Grid, TriMesh};

/// Settings of [`mesh_from_views`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshConfig {
    /// Which depths to leave out.
    pub mask: MaskConfig,
    /// Resolution; `None` takes [`TsdfConfig::from_pixel_footprint`].
    pub tsdf: Option<TsdfConfig>,
    /// Weigh pixels by `cos^2 / z^2` (viewing angle, depth), times the given weights, if any. The band behind
    /// a silhouette then hardly pulls on surfaces that other views see frontally.
    pub weigh_by_geometry: bool,
    /// Components kept, see [`filter_components`]; 1 for evaluation.
    pub keep: usize,
    /// Components with fewer triangles are dropped.
    pub min_triangles: usize,
}

impl Default for MeshConfig {
    fn default() -> Self {
        Self { mask: MaskConfig::default(), tsdf: None, weigh_by_geometry: true, keep: 50, min_triangles: 50 }
    }
}

/// Cosine below which angles are not told apart: 84 degrees, where the mask ends by default.
const MIN_COSINE: f64 = 0.1;

/// What [`mesh_from_views`] chose, removed and made.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshReport {
    /// Removed pixels, per view.
    pub masks: Vec<MaskCounts>,
    /// The resolution used.
    pub tsdf: TsdfConfig,
    /// Pixels left out because they were wider than [`TsdfConfig::MAX_FOOTPRINT`] voxels.
    pub cut_pixels: usize,
    /// Blocks of 8x8x8 voxels.
    pub num_blocks: usize,
    /// Bytes held by the field.
    pub num_bytes: usize,
    /// Triangles before the component filter.
    pub extracted_triangles: usize,
    /// Components found and removed.
    pub components: ComponentReport,
}

/// Fuses depth maps into one triangle mesh, scene frame and units.
///
/// The mesh is empty, and no error, when depths exist but nothing survives the component filter.
///
/// # Errors
/// Those of [`fuse`]; [`MeshError::NoDepth`] also when the mask leaves no pixel.
///
/// ```
/// use surfel_core::{Camera, Grid, Intrinsics, Rigid};
/// use surfel_mesh::{DepthView, MeshConfig, mesh_from_views};
///
/// let intrinsics = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0 };
/// let camera = Camera { intrinsics, width: 64, height: 48, camera_from_world: Rigid::IDENTITY };
/// let (depth, colour) = (Grid::filled(64, 48, 2.0), Grid::filled(64, 48, [0.8, 0.5, 0.2]));
/// let wall = DepthView { camera: &camera, depth: &depth, colour: &colour, weight: None };
/// let (mesh, report) = mesh_from_views(&[wall], &MeshConfig::default())?;
/// assert!(mesh.positions.iter().all(|p| (p[2] - 2.0).abs() < 1e-3));
/// assert_eq!(report.components.num_kept, 1);
/// # Ok::<(), surfel_mesh::MeshError>(())
/// ```
pub fn mesh_from_views(views: &[DepthView<'_>], config: &MeshConfig) -> Result<(TriMesh, MeshReport), MeshError> {
    for (index, view) in views.iter().enumerate() {
        view.check(index)?;
    }
    let prepared: Vec<Prepared> = views.iter().map(|view| Prepared::new(view, config)).collect();
    let masked: Vec<DepthView<'_>> = views
        .iter()
        .zip(&prepared)
        .map(|(view, ours)| DepthView { depth: &ours.depth, weight: ours.weight.as_ref().or(view.weight), ..*view })
        .collect();
    let chosen = config.tsdf.or_else(|| TsdfConfig::from_pixel_footprint(&masked));
    let tsdf_config = match chosen {
        Some(chosen) => chosen,
        None if views.is_empty() => return Err(MeshError::NoViews),
        None => {
            return Err(MeshError::NoDepth { num_views: views.len() });
        }
    };
    let tsdf = fuse(&masked, &tsdf_config)?;
    let extracted = tsdf.extract();
    let (mesh, components) = filter_components(&extracted, config.keep, config.min_triangles);
    let report = MeshReport {
        masks: prepared.iter().map(|ours| ours.counts).collect(),
        tsdf: tsdf_config,
        cut_pixels: tsdf.num_cut_pixels(),
        num_blocks: tsdf.num_blocks(),
        num_bytes: tsdf.num_bytes(),
        extracted_triangles: extracted.triangles.len(),
        components,
    };
    Ok((mesh, report))
}

/// The maps of one view after masking.
struct Prepared {
    depth: Grid<f32>,
    /// `None`: use the caller's.
    weight: Option<Grid<f32>>,
    counts: MaskCounts,
}

impl Prepared {
    fn new(view: &DepthView<'_>, config: &MeshConfig) -> Self {
        let normals = normals_to_the_rim(view.depth, &view.camera.intrinsics);
        let (depth, counts) = mask_unreliable(view.depth, view.camera, Some(&normals), &config.mask);
        let weight = config.weigh_by_geometry.then(|| {
            Grid::from_fn(depth.width(), depth.height(), |x, y| {
                let given = view.weight.map_or(1.0, |weight| weight[(x, y)]);
                let cosine = normals[(x, y)].map_or(1.0, |n| facing(view.camera, x, y, n).max(MIN_COSINE));
                given * (cosine / f64::from(view.depth[(x, y)])).powi(2) as f32
            })
        });
        Self { depth, weight, counts }
    }
}
