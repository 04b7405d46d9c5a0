//! The tables of an evaluation on rendered scenes: one row per method and size, then one per scene.
//!
//! Invariant: a mean is over scenes, each counting once, and a value no scene has is shown as none.

use super::method::Method;
use super::synth::{SceneScore, SynthSettings};
use surfel_eval::calibration_plot::calibration_svg;
use surfel_eval::normal_metrics::NormalScore;
use surfel_eval::report::{Cell, Figure, Report, Table};
use surfel_eval::{Calibration, DepthScore, SurfaceScore, ViewScore};

/// The means over scenes of each method and size, in order of appearance.
pub fn means(scores: &[SceneScore]) -> Vec<SceneScore> {
    let mut groups: Vec<Vec<&SceneScore>> = Vec::new();
    for score in scores {
        let same = |group: &&mut Vec<&SceneScore>| (&group[0].method, group[0].size) == (&score.method, score.size);
        match groups.iter_mut().find(same) {
            Some(group) => group.push(score),
            None => groups.push(vec![score]),
        }
    }
    groups.iter().filter_map(|group| mean(group)).collect()
}

fn mean(group: &[&SceneScore]) -> Option<SceneScore> {
    let first = group.first()?;
    let views: Vec<ViewScore> = group.iter().map(|s| s.view).collect();
    let surface = |field: fn(&SceneScore) -> Option<SurfaceScore>| {
        SurfaceScore::mean(&group.iter().filter_map(|s| field(s)).collect::<Vec<_>>())
    };
    Some(SceneScore {
        method: first.method.clone(),
        scene: format!("mean of {}", group.len()),
        size: first.size,
        view: ViewScore::mean(&views)?,
        calibration: merged(group),
        depth_surface: surface(|s| s.depth_surface),
        mesh_surface: surface(|s| s.mesh_surface),
        seconds: group.iter().map(|s| s.seconds).sum::<f64>() / group.len() as f64,
    })
}

/// All answers of a method together, since a bin of one scene may hold few.
fn merged(group: &[&SceneScore]) -> Option<Calibration> {
    group.iter().filter_map(|score| score.calibration).reduce(|mut all, next| {
        all.merge(&next);
        all
    })
}

/// The report of an evaluation; `scenes` says in words which scenes they were.
pub fn report(scores: &[SceneScore], settings: &SynthSettings, scenes: &str) -> Report {
    let mut depth = Table::new("Depth and normals, mean over scenes", DEPTH_COLUMNS);
    let mut surface = Table::new("Surface of the objects, mean over scenes", SURFACE_COLUMNS);
    for score in means(scores) {
        depth.push(depth_row(&score));
        push_surfaces(&mut surface, &score);
    }
    let mut per_scene_depth = Table::new("Depth and normals per scene", DEPTH_COLUMNS);
    let mut per_scene = Table::new("Surface of the objects per scene", SURFACE_COLUMNS);
    for score in scores {
        per_scene_depth.push(depth_row(score));
        push_surfaces(&mut per_scene, score);
    }
    Report {
        title: "Rendered scenes against their exact surfaces".to_owned(),
        notes: notes(settings, scenes),
        tables: vec![depth, surface, per_scene_depth, per_scene],
        figures: reliability(scores).into_iter().collect(),
    }
}

/// The reliability diagrams of all methods that give confidences.
fn reliability(scores: &[SceneScore]) -> Option<Figure> {
    let panel = |score: SceneScore| Some((format!("{}, {}", score.method, size(&score)), score.calibration?));
    let panels: Vec<(String, Calibration)> = means(scores).into_iter().filter_map(panel).collect();
    (!panels.is_empty()).then(|| Figure {
        title: "Share of pixels within 1 % of the true depth over their confidence".to_owned(),
        file: "calibration.svg".to_owned(),
        content: calibration_svg(&panels).into_bytes(),
    })
}

fn notes(settings: &SynthSettings, scenes: &str) -> Vec<String> {
    let SynthSettings { cap, threshold, spacing, .. } = settings;
    let described = |method: &Method| format!("`{}`: {}", method.name, method.says);
    let methods: Vec<String> = settings.methods.iter().map(described).collect();
    vec![
        format!("Scenes: {scenes}."),
        format!("Methods: {}.", methods.join("; ")),
        "Calibration error: root mean square difference between confidence and the share of pixels within 1 %, over \
         ten bins of the pixels that have a depth."
            .to_owned(),
        "Depth: shares are of all pixels with a true depth, a missing depth is a miss; errors are millimetres, over \
         pixels with a depth; bias is the median of the signed error, above zero behind the surface. Normals: angle to the exact normals on object pixels, of the depth map and as the \
         surfels show them; MSE is the mean of the squared difference summed over x, y, z, and that over 3."
            .to_owned(),
        format!(
            "Surface: millimetres; every distance counts at most {cap} mm, which is what a missing surface costs; \
             precision, recall and F-score at {threshold} mm. The reference are exact points {spacing} mm apart on \
             what the views see of the objects; depth maps are scored by their pixels on objects, meshes by points \
             inside the silhouettes of all views. The rows `exact` show what this sampling alone costs, and the mesher \
             where it is given the exact depth."
        ),
    ]
}

const DEPTH_COLUMNS: [&str; 16] = [
    "method",
    "size",
    "scene",
    "within 1 %",
    "within 1 %, objects",
    "coverage",
    "coverage, objects",
    "median error, objects",
    "mean error, objects",
    "bias, objects",
    "normals of depth, deg",
    "normals, deg",
    "normal MSE (sum)",
    "normal MSE (/3)",
    "calibration error",
    "seconds",
];

fn depth_row(score: &SceneScore) -> Vec<Cell> {
    let object = score.view.object_depth;
    let share = |field: fn(&DepthScore) -> f64| Cell::Share(object.as_ref().map_or(f64::NAN, field));
    let length = |field: fn(&DepthScore) -> f64| Cell::Value(object.as_ref().map_or(f64::NAN, field), 3);
    let angle = |normals: Option<NormalScore>| Cell::Value(normals.map_or(f64::NAN, |n| n.mean_angle_deg), 2);
    let normals = score.view.object_normals;
    vec![
        score.method.clone().into(),
        size(score).into(),
        score.scene.clone().into(),
        Cell::Share(score.view.depth.within_1pct),
        share(|d| d.within_1pct),
        Cell::Share(score.view.depth.coverage),
        share(|d| d.coverage),
        length(|d| d.median_abs_error),
        length(|d| d.mean_abs_error),
        length(|d| d.bias),
        angle(score.view.object_depth_normals),
        angle(normals),
        Cell::Value(normals.map_or(f64::NAN, |n| n.mse_sum), 4),
        Cell::Value(normals.map_or(f64::NAN, |n| n.mse_mean), 4),
        Cell::Value(score.calibration.and_then(|c| c.error()).unwrap_or(f64::NAN), 3),
        Cell::Value(score.seconds, 2),
    ]
}

const SURFACE_COLUMNS: [&str; 10] =
    ["method", "size", "scene", "surface", "accuracy", "completeness", "Chamfer", "precision", "recall", "F-score"];

fn push_surfaces(table: &mut Table, score: &SceneScore) {
    for (name, surface) in [("depth maps", score.depth_surface), ("mesh", score.mesh_surface)] {
        let Some(s) = surface else { continue };
        table.push([
            score.method.clone().into(),
            size(score).into(),
            score.scene.clone().into(),
            name.into(),
            Cell::Value(s.chamfer.accuracy, 3),
            Cell::Value(s.chamfer.completeness, 3),
            Cell::Value(s.chamfer.overall, 3),
            Cell::Share(s.f_score.precision),
            Cell::Share(s.f_score.recall),
            Cell::Share(s.f_score.f_score),
        ]);
    }
}

fn size(score: &SceneScore) -> String {
    format!("{}x{}", score.size[0], score.size[1])
}
