//! What each part brings: a method and the same without one part, on the same rendered scenes (the paper's table 3).
//!
//! Invariant: whole and parts see the same photographs, and the first row is the whole.

use super::method::Method;
use super::synth::{SceneScore, SynthSettings};
use super::synth_report::means;
use surfel_eval::paper_tables::TABLE_3;
use surfel_eval::report::{Cell, Report, Table};

/// The report; `scenes` says in words which scenes they were.
pub fn report(scores: &[SceneScore], settings: &SynthSettings, scenes: &str) -> Report {
    let columns = [
        "method",
        "size",
        "scenes",
        "Chamfer, mesh",
        "Chamfer, depth maps",
        "normal MSE (sum)",
        "normal MSE (/3)",
        "normals, deg",
        "within 1 %",
        "F-score, mesh",
    ];
    let mut table = Table::new("One part left out, mean over scenes", columns);
    for score in means(scores) {
        let normals = score.view.object_normals;
        let chamfer = |s: Option<surfel_eval::SurfaceScore>| Cell::Value(s.map_or(f64::NAN, |s| s.chamfer.overall), 3);
        table.push([
            score.method.into(),
            format!("{}x{}", score.size[0], score.size[1]).into(),
            score.scene.into(),
            chamfer(score.mesh_surface),
            chamfer(score.depth_surface),
            Cell::Value(normals.map_or(f64::NAN, |n| n.mse_sum), 4),
            Cell::Value(normals.map_or(f64::NAN, |n| n.mse_mean), 4),
            Cell::Value(normals.map_or(f64::NAN, |n| n.mean_angle_deg), 2),
            Cell::Share(score.view.depth.within_1pct),
            Cell::Share(score.mesh_surface.map_or(f64::NAN, |s| s.f_score.f_score)),
        ]);
    }
    let mut paper = Table::new("The paper's table 3, on DTU", ["method", "Chamfer", "normal MSE"]);
    for (method, chamfer, mse) in TABLE_3 {
        paper.push([method.into(), Cell::Value(chamfer, 2), Cell::Value(mse, 3)]);
    }
    let described = |method: &Method| format!("`{}`: {}", method.name, method.says);
    Report {
        title: "Ablation".to_owned(),
        notes: vec![
            format!("Scenes: {scenes}."),
            format!("Methods: {}.", settings.methods.iter().map(described).collect::<Vec<_>>().join("; ")),
            format!(
                "Millimetres against exact surfaces; a missing or stray point costs {} mm at most. The paper's rows \
                 are measured on DTU's test scans against other references, so only the direction of the changes \
                 compares, never the values.",
                settings.cap
            ),
        ],
        tables: vec![table, paper],
        figures: Vec::new(),
    }
}
