//! `report.json`: everything that was chosen, measured and warned about.
//!
//! Lengths are in scene units. Invariant: a run can be repeated from the numbers in here.

use super::cameras::{CameraTurn, PairCheck};
use super::progress::Timing;
use serde::Serialize;
use std::path::PathBuf;

/// The whole account of one reconstruction.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Version of the program.
    pub version: &'static str,
    /// Folder of the scene.
    pub scene: PathBuf,
    /// The format as it was detected.
    pub format: String,
    /// Which depth method was used.
    pub depth_method: &'static str,
    /// Why these views were chosen.
    pub views_chosen: String,
    /// Per view.
    pub views: Vec<ViewReport>,
    /// Sanity verdicts on the cameras that were used.
    pub camera_checks: Vec<PairCheck>,
    /// How the cameras were turned to meet the photographs, if they were.
    pub camera_turn: Option<CameraTurn>,
    /// The frame the road computed in.
    pub working_frame: WorkingFrame,
    /// The surfels.
    pub surfels: SurfelReport,
    /// The mesh.
    pub mesh: MeshNumbers,
    /// Wall-clock time per stage.
    pub timings: Vec<Timing>,
    /// Their sum, milliseconds.
    pub total_ms: f64,
    /// Peak resident memory of the process, mebibytes, where the system tells.
    pub peak_memory_mib: Option<f64>,
    /// Threads used.
    pub threads: usize,
    /// What a person should know.
    pub warnings: Vec<String>,
    /// Files written, relative to the output folder.
    pub files: Vec<String>,
}

/// One view.
#[derive(Clone, Debug, Serialize)]
pub struct ViewReport {
    /// As the camera file names it.
    pub name: String,
    /// Stem under which its maps are written.
    pub stem: String,
    /// Working width in pixels.
    pub width: usize,
    /// Working height in pixels.
    pub height: usize,
    /// Nearest z-depth searched.
    pub near: f64,
    /// Farthest z-depth searched.
    pub far: f64,
    /// Where the range comes from.
    pub range_from: String,
    /// Names of the views it was matched with.
    pub matched_with: Vec<String>,
    /// Depth candidates of the sweep.
    pub num_candidates: usize,
    /// Share of pixels with a depth.
    pub share_with_depth: f64,
    /// Share of pixels with confidence above one half.
    pub share_confident: f64,
}

/// The similarity between the scene and the frame of computation.
#[derive(Clone, Debug, Serialize)]
pub struct WorkingFrame {
    /// Working units per scene unit: one over the longest baseline.
    pub scale: f64,
    /// `working_from_scene` rotation, row-major.
    pub rotation: [f64; 9],
    /// `working_from_scene` translation, working units.
    pub translation: [f64; 3],
}

/// The surfels in numbers.
#[derive(Clone, Debug, Serialize)]
pub struct SurfelReport {
    /// How many.
    pub count: usize,
    /// Standard deviation of a pixel's footprint before the low-pass, pixels.
    pub footprint_px: f64,
    /// Standard deviation of the low-pass, pixels.
    pub low_pass_px: f64,
}

/// The mesh in numbers.
#[derive(Clone, Debug, Serialize)]
pub struct MeshNumbers {
    /// Vertices.
    pub vertices: usize,
    /// Triangles.
    pub triangles: usize,
    /// Voxel edge.
    pub voxel: f64,
    /// Truncation distance.
    pub truncation: f64,
    /// Pixels removed before fusion, per view: too far away to be measured by the baseline.
    pub removed_too_far: Vec<usize>,
    /// ... at the image border.
    pub removed_border: Vec<usize>,
    /// ... at depth edges.
    pub removed_depth_edge: Vec<usize>,
    /// ... seen at a grazing angle.
    pub removed_grazing: Vec<usize>,
    /// Connected components found.
    pub components: usize,
    /// Connected components kept.
    pub components_kept: usize,
    /// Triangles of the components that were dropped.
    pub removed_triangles: usize,
    /// Corners of the axis-aligned bounding box, scene frame; absent for an empty mesh.
    pub bounds: Option<[[f64; 3]; 2]>,
}

/// Peak resident memory of this process so far, MiB.
pub fn peak_memory_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1024.0)
}
