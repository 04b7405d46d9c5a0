//! What a method said about a scene, in the scene's own frame and units, ready to be scored.
//!
//! Invariant: views correspond one to one to the views of the scene they were asked of.

use super::error::ExperimentError;
use super::export::{stem, write_inputs};
use super::method::{DepthFrom, Method};
use crate::reconstruct::mesh::{MeshChoice, mesh_from_depth};
use crate::reconstruct::{Options, Report, Walked};
use std::path::Path;
use surfel_core::{Camera, Grid, TriMesh, View};
use surfel_eval::normal_metrics::{NormalMap, normal_map};
use surfel_io::depth::read_pfm;
use surfel_io::ply::read_ply_file;
use surfel_synth::TrueScene;

/// One method's answer.
pub struct Prediction {
    /// Per view of the scene.
    pub views: Vec<PredictedView>,
    /// The surface, scene frame; `None` for a method that makes none.
    pub mesh: Option<TriMesh>,
    /// Account of the run; `None` for the truth.
    pub report: Option<Report>,
}

/// One view's maps.
pub struct PredictedView {
    /// Camera of the maps, scene frame.
    pub camera: Camera,
    /// z-depth, scene units, 0 = none.
    pub depth: Grid<f32>,
    /// Camera frame; `None` for a method that predicts none.
    pub normals: Option<NormalMap>,
    /// Probability that the depth is right, as the method sees it; `None` for a method that says nothing of it.
    pub confidence: Option<Grid<f32>>,
}

impl Prediction {
    /// What `method` makes of the photographs of a rendered scene at their own size; `scratch` is an empty folder for
    /// them.
    ///
    /// # Errors
    /// [`ExperimentError`] when the road stops, the photographs cannot be written or the files cannot be read.
    pub fn of(method: &Method, scene: &TrueScene, options: &Options, scratch: &Path) -> Result<Self, ExperimentError> {
        match (&method.depth, method.options(options)) {
            (DepthFrom::Files(folder), _) => Self::stored(&folder.join(&scene.name), scene),
            (_, None) => Self::truth(scene),
            (_, Some(options)) => {
                write_inputs(&scene.views, scratch)?;
                let camera = &scene.views[0].view.camera;
                let options = Options {
                    views: (0..scene.views.len()).map(stem).collect(),
                    size: Some((camera.width, camera.height)),
                    ..options
                };
                let stopped =
                    |error| ExperimentError::Reconstruct { scene: scene.name.clone(), source: Box::new(error) };
                let (walked, report) = Walked::without_writing(scratch, &options).map_err(stopped)?;
                Ok(Self::in_scene(&walked, report))
            }
        }
    }

    /// Reads what another program made of a scene.
    fn stored(folder: &Path, scene: &TrueScene) -> Result<Self, ExperimentError> {
        let view = |(index, view): (usize, &surfel_synth::RenderedView)| {
            let path = folder.join(format!("depth/{}.pfm", stem(index)));
            let depth = read_pfm(&path).map_err(|error| ExperimentError::Request(error.to_string()))?;
            let camera = view.view.camera.resized(depth.width(), depth.height());
            Ok(PredictedView { camera, depth, normals: None, confidence: None })
        };
        let views = scene.views.iter().enumerate().map(view).collect::<Result<_, ExperimentError>>()?;
        let path = folder.join("mesh.ply");
        let mesh = path.is_file().then(|| read_ply_file(&path)).transpose();
        let mesh = mesh.map_err(|error| ExperimentError::Request(error.to_string()))?;
        Ok(Self { views, mesh, report: None })
    }

    /// The exact depth, and the mesh that the road would make of it: not the whole objects, since no photograph shows
    /// their far sides and no method is asked for them.
    fn truth(scene: &TrueScene) -> Result<Self, ExperimentError> {
        let view = |view: &surfel_synth::RenderedView| PredictedView {
            camera: view.view.camera,
            depth: view.depth.clone(),
            normals: Some(normal_map(&view.normal)),
            confidence: None,
        };
        let photographs: Vec<View> = scene.views.iter().map(|view| view.view.clone()).collect();
        let depths: Vec<Grid<f32>> = scene.views.iter().map(|view| view.depth.clone()).collect();
        let stopped = |error: surfel_mesh::MeshError| ExperimentError::Reconstruct {
            scene: scene.name.clone(),
            source: Box::new(error.into()),
        };
        let (mesh, _) = mesh_from_depth(&photographs, &depths, MeshChoice::default()).map_err(stopped)?;
        Ok(Self { views: scene.views.iter().map(view).collect(), mesh: Some(mesh), report: None })
    }

    /// What the road found, carried back from its working frame.
    fn in_scene(walked: &Walked, report: Report) -> Self {
        let scene_from_working = &walked.road.scene_from_working;
        let unit = scene_from_working.scale as f32;
        let view = |v: usize| PredictedView {
            camera: walked.road.views[v].camera.in_frame(scene_from_working),
            depth: walked.maps[v].depth.map(|z| z * unit),
            normals: Some(normal_map(&walked.maps[v].normal)),
            confidence: Some(walked.estimates[v].confidence.clone()),
        };
        let carry = |p: &[f32; 3]| scene_from_working.transform(glam::Vec3::from(*p).as_dvec3()).as_vec3().to_array();
        let mesh = TriMesh {
            positions: walked.mesh.positions.iter().map(carry).collect(),
            triangles: walked.mesh.triangles.clone(),
            ..TriMesh::default()
        };
        let views = (0..walked.maps.len()).map(view).collect();
        Self { views, mesh: Some(mesh), report: Some(report) }
    }
}
