//! The last step of the road: every file, in the scene's own frame and units, whole or not at all.

use super::maps::ViewMaps;
use super::report::Report;
use glam::DQuat;
use surfel_core::{Camera, Grid, Similarity, Surfels, TriMesh, View};
use surfel_io::write::cameras_json::{CameraRecord, write_cameras_json};
use surfel_io::write::confidence_png::write_confidence_png;
use surfel_io::write::depth_png::{depth_png_unit, write_depth_png, write_depth_sidecar};
use surfel_io::write::glb::{GLTF_FROM_OPENCV, write_glb};
use surfel_io::write::normal_png::write_normal_png;
use surfel_io::write::pfm::write_pfm;
use surfel_io::write::ply_mesh::write_ply_mesh;
use surfel_io::write::ply_surfels::{SplatLayout, write_surfels_ply};
use surfel_io::write::preview::{CAPTIONS, PreviewRow, write_preview};
use surfel_io::write::{PlacedMesh, StagedDir, WriteError};
use surfel_mesh::render::render_mesh;

/// Everything that becomes a file. Views, maps and mesh are in the working frame.
pub struct Outputs<'a> {
    /// Photographs at the working size.
    pub views: &'a [View],
    /// Stem per view.
    pub stems: &'a [String],
    /// File name of each photograph, for `cameras.json`.
    pub images: &'a [String],
    /// Near and far per view, scene units.
    pub ranges: &'a [(f64, f64)],
    /// Rendered maps per view.
    pub maps: &'a [ViewMaps],
    /// The depth of each view that the mesh was made of.
    pub meshed: &'a [Grid<f32>],
    /// Confidence per view.
    pub confidence: Vec<&'a Grid<f32>>,
    /// The surfels.
    pub surfels: &'a Surfels,
    /// The mesh.
    pub mesh: &'a TriMesh,
    /// Back to the scene.
    pub scene_from_working: Similarity,
}

/// What the headers of the meshes say.
const FRAME_COMMENT: &str = "frame and unit are those of the input cameras (OpenCV axes per camera, z-depth)";

impl Outputs<'_> {
    /// Writes all files but the report; returns their names.
    pub fn write(&self, staged: &StagedDir) -> Result<Vec<String>, WriteError> {
        let mut names = Vec::new();
        let mut note = |name: String| {
            names.push(name.clone());
            name
        };
        let placed = PlacedMesh { mesh: self.mesh, scene_from_mesh: self.scene_from_working };
        staged.write(note("mesh.ply".into()), |out| write_ply_mesh(out, &placed, &[FRAME_COMMENT]))?;
        if !self.mesh.triangles.is_empty() {
            staged.write(note("mesh.glb".into()), |out| write_glb(out, &placed, self.upright()))?;
        }
        staged.write(note("surfels.ply".into()), |out| {
            write_surfels_ply(out, self.surfels, &self.scene_from_working, SplatLayout::ThreeScales, &[FRAME_COMMENT])
        })?;
        let unit = self.scene_from_working.scale as f32;
        for ((stem, maps), confidence) in self.stems.iter().zip(self.maps).zip(&self.confidence) {
            let depth = maps.depth.map(|z| z * unit);
            let count = depth_png_unit(depth.as_slice().iter().copied().fold(0.0, f32::max));
            staged.write(note(format!("depth/{stem}.pfm")), |out| write_pfm(out, &depth))?;
            staged.write(note(format!("depth/{stem}.png")), |out| write_depth_png(out, &depth, count))?;
            staged.write(note(format!("depth/{stem}.json")), |out| write_depth_sidecar(out, &depth, count))?;
            staged.write(note(format!("normal/{stem}.png")), |out| write_normal_png(out, &maps.normal))?;
            staged.write(note(format!("confidence/{stem}.png")), |out| write_confidence_png(out, confidence))?;
        }
        let scene_cameras: Vec<Camera> =
            self.views.iter().map(|v| v.camera.in_frame(&self.scene_from_working)).collect();
        let records: Vec<CameraRecord> = (0..self.views.len())
            .map(|v| CameraRecord { image: &self.images[v], camera: &scene_cameras[v], near_far: Some(self.ranges[v]) })
            .collect();
        staged.write(note("cameras.json".into()), |out| write_cameras_json(out, &records))?;
        self.write_preview(staged, note("preview.png".into()))?;
        Ok(names)
    }

    fn write_preview(&self, staged: &StagedDir, name: String) -> Result<(), WriteError> {
        let unit = self.scene_from_working.scale as f32;
        let depths: Vec<Grid<f32>> = self.maps.iter().map(|maps| maps.depth.map(|z| z * unit)).collect();
        let believed: Vec<Grid<f32>> = self.meshed.iter().map(|depth| depth.map(|z| z * unit)).collect();
        let meshes: Vec<Grid<[f32; 3]>> =
            self.views.iter().map(|view| render_mesh(self.mesh, &view.camera).colour).collect();
        let rows: Vec<PreviewRow> = (0..self.views.len())
            .map(|v| PreviewRow {
                photo: &self.views[v].image,
                depth: &depths[v],
                believed: &believed[v],
                normal: &self.maps[v].normal,
                last: &meshes[v],
                captions: CAPTIONS,
            })
            .collect();
        staged.write(name, |out| write_preview(out, &rows))
    }

    /// glTF wants Y up; up is where the first photograph has it.
    fn upright(&self) -> DQuat {
        let camera = self.views[0].camera.in_frame(&self.scene_from_working);
        GLTF_FROM_OPENCV * DQuat::from_mat3(&camera.camera_from_world.rotation)
    }
}

/// Writes `report.json`.
pub fn write_report(staged: &StagedDir, report: &Report) -> Result<(), WriteError> {
    staged.write("report.json", |out| Ok(serde_json::to_writer_pretty(out, report)?))
}
