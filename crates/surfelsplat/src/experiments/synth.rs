//! Methods on rendered scenes, scored against exact depth, normals and surface.
//!
//! A pixel of the objects counts wherever the method left it empty; a surface is scored by its points inside the
//! objects' silhouettes against exact points on what the views see of them. Invariant: scene, size and seed fix every
//! input, so two runs differ by nothing but time.

use super::error::ExperimentError;
use super::method::Method;
use super::predicted::{PredictedView, Prediction};
use crate::reconstruct::Options;
use glam::Vec3;
use serde::Serialize;
use surfel_core::{Camera, Grid, TriMesh};
use surfel_eval::depth_map::restricted_to;
use surfel_eval::normal_metrics::normal_map;
use surfel_eval::object_chamfer::back_projected;
use surfel_eval::sample_mesh::sample_mesh_near;
use surfel_eval::view_score::{PredictedMaps, TrueMaps};
use surfel_eval::{Calibration, SurfaceScore, ViewScore, score_surface, score_view};
use surfel_synth::{RenderedView, SceneSource, TrueScene};

/// What is measured, and how strictly. Lengths are millimetres, as rendered scenes are.
#[derive(Clone, Debug)]
pub struct SynthSettings {
    /// Names of the scenes.
    pub seeds: Vec<u64>,
    /// Methods, in the order of the tables.
    pub methods: Vec<Method>,
    /// What a missing or stray point costs at most.
    pub cap: f64,
    /// Distance below which a point is right, for the F-score.
    pub threshold: f64,
    /// Mean distance of the exact points, and of the points on a mesh.
    pub spacing: f64,
    /// What every road has in common.
    pub options: Options,
}

/// Mean distance of the exact points on a DTU-like tabletop, millimetres.
pub const SPACING: f64 = 0.5;

impl SynthSettings {
    /// The settings of DTU, as far as they carry over: 20 mm cap; 1 mm threshold; points 0.5 mm apart.
    pub fn new(seeds: Vec<u64>, methods: Vec<Method>) -> Self {
        Self { seeds, methods, cap: 20.0, threshold: 1.0, spacing: SPACING, options: Options::default() }
    }

    /// The same for scenes that are `factor` times as large.
    #[must_use]
    pub fn magnified(self, factor: f64) -> Self {
        let Self { cap, threshold, spacing, .. } = self;
        Self { cap: factor * cap, threshold: factor * threshold, spacing: factor * spacing, ..self }
    }
}

/// One method on one scene, or the mean over several scenes.
#[derive(Clone, Debug, Serialize)]
pub struct SceneScore {
    /// Name of the method.
    pub method: String,
    /// Name of the scene.
    pub scene: String,
    /// Size of the photographs, pixels.
    pub size: [usize; 2],
    /// Mean over the views.
    pub view: ViewScore,
    /// Confidences of all pixels with a true and a predicted depth, right within 1 %; `None` for a method without.
    pub calibration: Option<Calibration>,
    /// The back-projected depth maps; `None` for a scene without objects in sight.
    pub depth_surface: Option<SurfaceScore>,
    /// The mesh; `None` also for a method without one.
    pub mesh_surface: Option<SurfaceScore>,
    /// Seconds from the photographs to the mesh; NaN (JSON null) for the truth.
    pub seconds: f64,
}

/// Runs every method on every scene of a source; `tell` hears the name of each run before it starts.
///
/// # Errors
/// [`ExperimentError`] when a scene cannot be drawn or a method stops on it.
pub fn evaluate(
    source: &SceneSource,
    settings: &SynthSettings,
    tell: &dyn Fn(&str),
) -> Result<Vec<SceneScore>, ExperimentError> {
    let mut scores = Vec::new();
    for &seed in &settings.seeds {
        tell(&format!("{}: rendering", source.name(seed)));
        let scene = source.scene(seed, settings.spacing)?;
        for method in &settings.methods {
            tell(&format!("{}: {}", scene.name, method.name));
            let scratch =
                tempfile::tempdir().map_err(|source| ExperimentError::File { path: std::env::temp_dir(), source })?;
            let prediction = Prediction::of(method, &scene, &settings.options, scratch.path())?;
            scores.extend(score(&method.name, &scene, &prediction, settings));
        }
    }
    Ok(scores)
}

/// Scores one prediction; `None` for a scene in which nothing has a depth.
pub fn score(method: &str, scene: &TrueScene, prediction: &Prediction, settings: &SynthSettings) -> Option<SceneScore> {
    let views: Vec<ViewScore> =
        scene.views.iter().zip(&prediction.views).filter_map(|(truth, view)| view_score(truth, view)).collect();
    let exact: Vec<[f32; 3]> = scene.surface.points.iter().map(|p| p.as_vec3().to_array()).collect();
    let surface = |points: &[[f32; 3]]| {
        (!exact.is_empty()).then(|| score_surface(points, &exact, settings.cap, settings.threshold))
    };
    let depth_points: Vec<[f32; 3]> =
        scene.views.iter().zip(&prediction.views).flat_map(|(truth, view)| points_on_objects(truth, view)).collect();
    let mesh_points = prediction.mesh.as_ref().map(|mesh| mesh_points(mesh, &scene.views, &exact, settings));
    let camera = &scene.views.first()?.view.camera;
    Some(SceneScore {
        method: method.to_owned(),
        scene: scene.name.clone(),
        size: [camera.width, camera.height],
        view: ViewScore::mean(&views)?,
        calibration: calibration(scene, prediction),
        depth_surface: surface(&depth_points),
        mesh_surface: mesh_points.and_then(|points| surface(&points)),
        seconds: prediction.report.as_ref().map_or(f64::NAN, |report| report.total_ms / 1e3),
    })
}

fn view_score(truth: &RenderedView, predicted: &PredictedView) -> Option<ViewScore> {
    let (normals, object) = (normal_map(&truth.normal), truth.object_mask());
    let truth =
        TrueMaps { intrinsics: &truth.view.camera.intrinsics, depth: &truth.depth, normals: &normals, object: &object };
    let maps = PredictedMaps {
        intrinsics: &predicted.camera.intrinsics,
        depth: &predicted.depth,
        normals: predicted.normals.as_ref().filter(|normals| normals.same_size(truth.depth)),
    };
    score_view(maps, truth)
}

/// A depth is right when it is this close to the truth, relative to it.
const RIGHT: f32 = 0.01;

/// `None` unless the method gives confidences at the size of the photographs.
fn calibration(scene: &TrueScene, prediction: &Prediction) -> Option<Calibration> {
    let mut calibration = Calibration::default();
    for (truth, view) in scene.views.iter().zip(&prediction.views) {
        let confidence = view.confidence.as_ref().filter(|map| map.same_size(&truth.depth))?;
        let pixels = truth.depth.as_slice().iter().zip(view.depth.as_slice()).zip(confidence.as_slice());
        for ((&z, &found), &confidence) in pixels.filter(|((z, found), _)| **z > 0.0 && **found > 0.0) {
            calibration.add(confidence, (found - z).abs() <= RIGHT * z);
        }
    }
    Some(calibration)
}

/// World points of the predicted depths of a view whose pixels show an object.
fn points_on_objects(truth: &RenderedView, predicted: &PredictedView) -> Vec<[f32; 3]> {
    let object = truth.object_mask();
    let (width, height) = (predicted.depth.width(), predicted.depth.height());
    let (sx, sy) = (object.width() as f64 / width as f64, object.height() as f64 / height as f64);
    let on_object = Grid::from_fn(width, height, |x, y| {
        let (u, v) = ((x as f64 + 0.5) * sx, (y as f64 + 0.5) * sy);
        object.get(u as isize, v as isize) == Some(&true)
    });
    back_projected(&restricted_to(&predicted.depth, &on_object), &predicted.camera)
}

/// Points on a mesh that may belong to the objects: on their silhouette in every view that could see them, as the DTU
/// protocol culls, so that a table behind an object is not asked to be the object.
fn mesh_points(mesh: &TriMesh, views: &[RenderedView], exact: &[[f32; 3]], settings: &SynthSettings) -> Vec<[f32; 3]> {
    let masks: Vec<(Camera, Grid<bool>)> = views.iter().map(|view| (view.view.camera, view.object_mask())).collect();
    let on_every_mask = |p: &[f32; 3]| {
        let point = Vec3::from(*p).as_dvec3();
        let mut seen = false;
        for (camera, mask) in &masks {
            let Some((pixel, _)) = camera.project(point) else { continue };
            match mask.get(pixel.x.floor() as isize, pixel.y.floor() as isize) {
                Some(true) => seen = true,
                Some(false) => return false,
                None => {}
            }
        }
        seen
    };
    let points = sample_mesh_near(mesh, settings.spacing, exact, settings.cap);
    points.into_iter().filter(on_every_mask).collect()
}
