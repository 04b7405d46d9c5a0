//! The whole road, from a folder of posed photographs to a coloured mesh.
//!
//! Data flows one way: input -> cameras -> range -> depth -> surfels -> maps -> mesh -> outputs; each step is a file of
//! this folder. Invariant: everything between input and outputs happens in a working frame whose unit is the
//! baseline, so a scene scaled by 1000 gives the same result scaled by 1000.

pub mod cameras;
pub mod choice;
pub mod depth;
pub mod depth_range;
mod error;
pub mod input;
pub mod maps;
pub mod mesh;
pub mod network;
pub mod options;
pub mod outputs;
pub mod progress;
pub mod report;
pub mod solid;
pub mod surfels;
pub mod working_frame;
pub mod working_size;

pub use error::ReconstructError;
pub use options::{DepthSource, Options};
pub use progress::{Progress, Silent, Stage};
pub use report::Report;

use cameras::{Checked, SparseMatches};
use depth_range::Range;
use input::Input;
use maps::{ViewMaps, render_views};
use mesh::{MeshChoice, mesh_from_depth};
use network::{FirstScales, Learned};
use outputs::{Outputs, write_report};
use progress::Log;
use report::{MeshNumbers, SurfelReport, ViewReport, WorkingFrame, peak_memory_mib};
use solid::{LeastConfidence, SolidDepth, solid_depth};
use std::path::Path;
use surfel_core::{Grid, Similarity, Surfels, TriMesh, View};
use surfel_io::write::{PlacedMesh, StagedDir};
use surfel_mesh::MeshReport;
use surfel_stereo::DepthEstimate;
use surfel_stereo::photographs::{features_of, match_views};

/// Reconstructs `scene` into the folder `out`.
///
/// # Errors
/// [`ReconstructError`]; then nothing has been written.
pub fn reconstruct(
    scene: &Path,
    out: &Path,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Report, ReconstructError> {
    let log = Log::new(progress);
    // First, so that a place that cannot be written to is refused before the work is done.
    let staged = StagedDir::new(out)?;
    let walked = Walked::walk(scene, options, &log)?;
    let files = log.stage(Stage::Write, || walked.outputs(|outputs| outputs.write(&staged)))?;
    let report = walked.report(options, files, &log);
    write_report(&staged, &report)?;
    staged.commit()?;
    Ok(report)
}

/// Everything the road found, in memory; nothing has been written.
pub struct Walked {
    /// The photographs and where they come from, scene frame.
    pub input: Input,
    /// What keypoints say of them.
    pub sparse: SparseMatches,
    /// What became of the cameras.
    pub checked: Checked,
    /// Depth range per view, scene units.
    pub ranges: Vec<Range>,
    /// The photographs in the working frame.
    pub road: Road,
    /// Depth, normal and confidence per view, working frame.
    pub estimates: Vec<DepthEstimate>,
    /// The surfels, working frame.
    pub surfels: Surfels,
    /// What the network's first pass said of them; `None` where no network ran.
    first_scales: Option<FirstScales>,
    /// What the surfels show to each view, working frame.
    pub maps: Vec<ViewMaps>,
    /// Pixels per view that show a surface too far away to be measured.
    num_too_far: Vec<usize>,
    /// What of their depth the mesh is made of, working frame.
    meshed: Vec<Grid<f32>>,
    /// The surface, working frame.
    pub mesh: TriMesh,
    mesh_report: MeshReport,
}

impl Walked {
    /// Walks the road up to the mesh, without a listener, and reports what each step took.
    ///
    /// # Errors
    /// [`ReconstructError`].
    pub fn without_writing(scene: &Path, options: &Options) -> Result<(Self, Report), ReconstructError> {
        let log = Log::new(&Silent);
        let walked = Self::walk(scene, options, &log)?;
        let report = walked.report(options, Vec::new(), &log);
        Ok((walked, report))
    }

    fn walk(scene: &Path, options: &Options, log: &Log) -> Result<Self, ReconstructError> {
        let mut input = log.stage(Stage::Read, || Input::read(scene, options, log))?;
        let (sparse, checked, ranges) = log.stage(Stage::Check, || {
            let sparse = SparseMatches::between(&input.views);
            let checked = cameras::check(&mut input.views, &sparse, options, log)?;
            let ranges = depth_range::ranges(&input, &sparse, options, log)?;
            Ok::<_, ReconstructError>((sparse, checked, ranges))
        })?;
        let road = Road::new(&input, &ranges)?;
        let features = log.stage(Stage::Features, || features_of(&road.views))?;
        let matched = log.stage(Stage::Depth, || {
            match_views(&road.views, &features, &sparse.neighbours, &road.ranges, &options.matching)
        });
        let (estimates, surfels, first_scales) = log.stage(Stage::Surfels, || road.surfels(matched, options))?;
        let steps: Vec<f32> = estimates.iter().map(|estimate| estimate.step).collect();
        let maps = log.stage(Stage::Render, || render_views(&surfels, &road.views, &road.ranges, &steps))?;
        let solid = road.solid(&maps, &estimates, options.depth.least_confidence());
        let num_too_far: Vec<usize> = solid.iter().map(|view| view.num_too_far).collect();
        say_what_is_too_far(&solid, log);
        let meshed: Vec<Grid<f32>> = solid.into_iter().map(|view| view.depth).collect();
        let (mesh, mesh_report) = log.stage(Stage::Mesh, || road.mesh(&meshed, options))?;
        if mesh.triangles.is_empty() {
            log.warn(
                "the mesh is empty: no surface was seen with confidence and near enough for this baseline; look at \
                 preview.png and confidence/",
            );
        }
        Ok(Self {
            input,
            sparse,
            checked,
            ranges,
            road,
            estimates,
            surfels,
            first_scales,
            maps,
            num_too_far,
            meshed,
            mesh,
            mesh_report,
        })
    }

    /// Scales of the surfels as first placed and as adapted to the sampling rate, working units, in the order of
    /// [`Self::surfels`], which may have been refined further.
    pub fn scales_before_and_after_adaptation(&self, options: &Options) -> FirstScales {
        self.first_scales.clone().unwrap_or_else(|| {
            let placed = |low_pass_px: f64| {
                let config = surfels::SurfelConfig { low_pass_px, ..options.surfels };
                surfels::surfels_from_depth(&self.road.views, &self.estimates, &config).scales
            };
            FirstScales { initial: placed(0.0), adapted: placed(options.surfels.low_pass_px) }
        })
    }

    /// Hands what becomes files to `write`.
    fn outputs<T>(&self, write: impl FnOnce(&Outputs) -> T) -> T {
        let images: Vec<String> =
            self.input.image_paths().iter().map(|path| path.to_string_lossy().into_owned()).collect();
        let scene_ranges: Vec<(f64, f64)> = self.ranges.iter().map(|r| (r.near, r.far)).collect();
        write(&Outputs {
            views: &self.road.views,
            stems: &self.input.stems(),
            images: &images,
            ranges: &scene_ranges,
            maps: &self.maps,
            meshed: &self.meshed,
            confidence: self.estimates.iter().map(|e| &e.confidence).collect(),
            surfels: &self.surfels,
            mesh: &self.mesh,
            scene_from_working: self.road.scene_from_working,
        })
    }
}

/// The views in the working frame.
pub struct Road {
    /// Photographs and cameras, working frame.
    pub views: Vec<View>,
    /// Near and far per view, working units.
    pub ranges: Vec<(f64, f64)>,
    /// Into the working frame.
    pub working_from_scene: Similarity,
    /// Back to the scene.
    pub scene_from_working: Similarity,
}

impl Road {
    fn new(input: &Input, ranges: &[Range]) -> Result<Self, ReconstructError> {
        let cameras: Vec<_> = input.views.iter().map(|view| view.camera).collect();
        let working_from_scene = working_frame::working_from_scene(&cameras).ok_or_else(|| {
            ReconstructError::Choice(format!("{}: the cameras stand in one place", input.scene.root.display()))
        })?;
        let views = input
            .views
            .iter()
            .map(|view| View { camera: view.camera.in_frame(&working_from_scene), ..view.clone() })
            .collect();
        let scale = working_from_scene.scale;
        let ranges = ranges.iter().map(|r| (r.near * scale, r.far * scale)).collect();
        Ok(Self { views, ranges, working_from_scene, scene_from_working: working_from_scene.inverse() })
    }

    /// One surfel per pixel: placed on matching's depth, or predicted by the network.
    fn surfels(
        &self,
        matched: Vec<DepthEstimate>,
        options: &Options,
    ) -> Result<(Vec<DepthEstimate>, Surfels, Option<FirstScales>), ReconstructError> {
        match &options.depth {
            DepthSource::Network(net) => {
                let learned = network::refine(net, &self.views, &matched, &self.ranges)?;
                let Learned { estimates, surfels, first_scales } = learned;
                Ok((estimates, surfels, Some(first_scales)))
            }
            DepthSource::Matching => {
                let surfels = surfels::surfels_from_depth(&self.views, &matched, &options.surfels);
                Ok((matched, surfels, None))
            }
        }
    }

    /// What of each view's depth the mesh may be made of.
    fn solid(&self, maps: &[ViewMaps], estimates: &[DepthEstimate], least: LeastConfidence) -> Vec<SolidDepth> {
        let views = self.views.iter().zip(maps).zip(estimates);
        views.map(|((view, maps), found)| solid_depth(maps, &view.camera, &found.confidence, least)).collect()
    }

    fn mesh(&self, depths: &[Grid<f32>], options: &Options) -> Result<(TriMesh, MeshReport), surfel_mesh::MeshError> {
        let choice = MeshChoice {
            voxel: options.voxel.map(|voxel| voxel * self.working_from_scene.scale),
            keep_components: options.keep_components,
        };
        mesh_from_depth(&self.views, depths, choice)
    }
}

/// One sentence for a person who looks for the hills in the mesh.
fn say_what_is_too_far(solid: &[SolidDepth], log: &Log) {
    let (num_too_far, num_pixels) =
        solid.iter().fold((0, 0), |(far, all), view| (far + view.num_too_far, all + view.depth.len()));
    if num_too_far > 0 {
        let share = 100.0 * num_too_far as f64 / num_pixels as f64;
        log.say(format!(
            "{share:.1} % of the pixels show what is too far to be measured by this baseline; the mesh leaves it out"
        ));
    }
}

impl Walked {
    fn report(&self, options: &Options, files: Vec<String>, log: &Log) -> Report {
        let (mesh, mesh_report) = (&self.mesh, &self.mesh_report);
        let frame = &self.road.working_from_scene;
        let unit = self.road.scene_from_working.scale;
        let placed = PlacedMesh { mesh, scene_from_mesh: self.road.scene_from_working };
        let masks = &mesh_report.masks;
        let timings = log.timings();
        Report {
            version: env!("CARGO_PKG_VERSION"),
            scene: self.input.scene.root.clone(),
            format: self.input.scene.format.to_string(),
            depth_method: options.depth.name(),
            views_chosen: self.input.reason.clone(),
            views: (0..self.road.views.len()).map(|v| self.view(v)).collect(),
            camera_checks: self.checked.checks.clone(),
            camera_turn: self.checked.turn.clone(),
            working_frame: WorkingFrame {
                scale: frame.scale,
                rotation: frame.rotation.transpose().to_cols_array(),
                translation: frame.translation.to_array(),
            },
            surfels: SurfelReport {
                count: self.surfels.len(),
                footprint_px: options.surfels.footprint_px,
                low_pass_px: options.surfels.low_pass_px,
            },
            mesh: MeshNumbers {
                vertices: mesh.positions.len(),
                triangles: mesh.triangles.len(),
                voxel: mesh_report.tsdf.voxel * unit,
                truncation: mesh_report.tsdf.truncation * unit,
                removed_too_far: self.num_too_far.clone(),
                removed_border: masks.iter().map(|m| m.border).collect(),
                removed_depth_edge: masks.iter().map(|m| m.depth_edge).collect(),
                removed_grazing: masks.iter().map(|m| m.grazing).collect(),
                components: mesh_report.components.num_components,
                components_kept: mesh_report.components.num_kept,
                removed_triangles: mesh_report.components.removed_triangles,
                bounds: placed.bounds().map(|(low, high)| [low.to_array(), high.to_array()]),
            },
            total_ms: timings.iter().map(|t| t.ms).sum(),
            timings,
            peak_memory_mib: peak_memory_mib(),
            threads: rayon::current_num_threads(),
            warnings: log.warnings(),
            files,
        }
    }

    fn view(&self, v: usize) -> ViewReport {
        let (view, estimate, range) = (&self.road.views[v], &self.estimates[v], &self.ranges[v]);
        let share = |count: usize| count as f64 / view.image.len().max(1) as f64;
        let frame = &self.input.scene.frames[self.input.frames[v]];
        ViewReport {
            name: frame.name.clone(),
            stem: self.input.stems()[v].clone(),
            width: view.camera.width,
            height: view.camera.height,
            near: range.near,
            far: range.far,
            range_from: range.sentence.clone(),
            matched_with: self.sparse.neighbours[v].iter().map(|&n| self.road.views[n].name.clone()).collect(),
            num_candidates: estimate.num_candidates,
            share_with_depth: share(self.maps[v].depth.as_slice().iter().filter(|&&z| z > 0.0).count()),
            share_confident: share(estimate.confidence.as_slice().iter().filter(|&&c| c > 0.5).count()),
        }
    }
}
