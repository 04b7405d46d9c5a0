//! `surfelsplat eval depth`: the depth maps and the mesh of a reconstruction against a scene's reference.
//!
//! Any folder with `depth/<stem>.pfm` can be scored, also a peer's. Invariant: a missing depth is a miss, and
//! holes of the surface cost the cap.

use crate::cli::args::positive_length;
use crate::cli::publish::publish;
use anyhow::{Context, Result, bail};
use clap::Args;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use surfel_core::{Camera, Grid};
use surfel_eval::depth_map::restricted_to;
use surfel_eval::depth_metrics::median;
use surfel_eval::object_chamfer::{back_projected, object_chamfer};
use surfel_eval::report::{Cell, Report, Table};
use surfel_eval::sample_mesh::sample_mesh_near;
use surfel_eval::{DepthMap, DepthScore, NormalScore, Reference, score_depth, score_depth_normals};
use surfel_io::depth::read_pfm;
use surfel_io::ply::read_ply_file;
use surfel_io::scene::{Frame, Scene};

#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  surfelsplat reconstruct scene --views 23,24 --size 320x256 -o out
  surfelsplat eval depth scene out")]
pub struct DepthArgs {
    /// Scene folder with a reference: pseudo_gt/, depth/ or disp0.pfm beside the photographs, or a mesh of the scene in
    /// truth/mesh.ply or pseudo_gt_mesh.ply.
    pub scene: PathBuf,

    /// Folder with depth/<stem>.pfm and cameras.json, as `reconstruct` writes it.
    pub output: PathBuf,

    /// Distance, in scene units, that a missed reference point counts as (default: 20 for millimetres, i.e.
    /// 3 % of the median reference depth).
    #[arg(long, value_name = "LENGTH", value_parser = positive_length)]
    pub cap: Option<f64>,

    /// Score only what the masks of the scene show (mask/ or masks/ beside the photographs; white counts).
    #[arg(long)]
    pub masks: bool,

    /// Folder to write the report into, as Markdown and JSON.
    #[arg(short = 'o', long, value_name = "DIR")]
    pub report: Option<PathBuf>,
}

/// One view with a prediction and a reference.
struct Scored {
    name: String,
    camera: Camera,
    predicted: Grid<f32>,
    reference: Grid<f32>,
    reference_camera: Camera,
}

/// Share of the median reference depth that a miss costs when no cap is given: 20 mm at 650 mm, as on DTU.
const CAP_SHARE: f64 = 20.0 / 650.0;

pub fn run(args: &DepthArgs, json: bool) -> Result<ExitCode> {
    let scene = Scene::open(&args.scene)?;
    let Some(reference) = Reference::open(&scene.root)? else {
        bail!(
            "{} has no reference: neither pseudo_gt/ nor depth/, no disp0.pfm, no truth/mesh.ply",
            scene.root.display()
        );
    };
    let scored = scored_views(&scene, &reference, args)?;
    if scored.is_empty() {
        bail!("no depth map of {} has a reference in {}", args.output.display(), scene.root.display());
    }
    publish(&report(&scored, args)?, args.report.as_deref(), json)?;
    Ok(ExitCode::SUCCESS)
}

fn scored_views(scene: &Scene, reference: &Reference, args: &DepthArgs) -> Result<Vec<Scored>> {
    let mut scored = Vec::new();
    for path in depth_maps(&args.output)? {
        let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        let index = scene.select(std::slice::from_ref(&stem))?[0];
        let frame = &scene.frames[index];
        let full = frame.pinhole();
        let Some((mut truth, _)) = reference.depth_of(&stem, &full)? else { continue };
        if args.masks {
            truth = restricted_to(&truth, &mask_of(frame, &truth)?);
        }
        let predicted = read_pfm(&path)?;
        scored.push(Scored {
            name: stem,
            camera: full.resized(predicted.width(), predicted.height()),
            reference_camera: full.resized(truth.width(), truth.height()),
            predicted,
            reference: truth,
        });
    }
    Ok(scored)
}

/// What the mask of a photograph shows, at the size of its reference.
fn mask_of(frame: &Frame, truth: &Grid<f32>) -> Result<Grid<bool>> {
    if frame.mask_path.is_none() {
        bail!("{} has no mask; put {}.png into masks/, or score without --masks", frame.name, frame.stem());
    }
    Ok(frame.load(truth.width(), truth.height())?.valid)
}

fn depth_maps(output: &Path) -> Result<Vec<PathBuf>> {
    let folder = output.join("depth");
    let entries = std::fs::read_dir(&folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let mut paths: Vec<PathBuf> =
        entries.flatten().map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "pfm")).collect();
    paths.sort();
    Ok(paths)
}

fn report(scored: &[Scored], args: &DepthArgs) -> Result<Report> {
    let mut depths: Vec<f64> = scored
        .iter()
        .flat_map(|s| s.reference.as_slice().iter().filter(|z| **z > 0.0).map(|z| f64::from(*z)))
        .collect();
    let cap = args.cap.unwrap_or(CAP_SHARE * median(&mut depths));
    let columns = [
        "view",
        "within 1 %",
        "within 2 %",
        "within 5 %",
        "coverage",
        "median error",
        "median error %",
        "bias",
        "normals mean deg",
        "normals median deg",
        "normal MSE (sum)",
        "normal MSE (/3)",
    ];
    let mut table = Table::new("Depth maps", columns);
    let mut depth_scores = Vec::new();
    let mut normal_scores = Vec::new();
    for s in scored {
        let predicted = DepthMap::new(&s.predicted, &s.camera.intrinsics);
        let truth = DepthMap::new(&s.reference, &s.reference_camera.intrinsics);
        let Some(depth) = score_depth(predicted, truth) else { continue };
        let normal = score_depth_normals(predicted, truth);
        table.push(row(&s.name, &depth, normal.as_ref()));
        depth_scores.push(depth);
        normal_scores.extend(normal);
    }
    if let Some(mean) = DepthScore::mean(&depth_scores) {
        table.push(row("mean", &mean, NormalScore::mean(&normal_scores).as_ref()));
    }
    Ok(Report {
        title: format!("{} against {}", args.output.display(), args.scene.display()),
        notes: vec![
            "Shares are of all reference pixels; a missing depth is a miss. Errors are in scene units, over pixels with a prediction; bias is the median of the signed error, above zero behind the reference. Normals are those of the depth maps.".to_owned(),
            format!("Distances count at most {cap:.4} scene units, which is also what a miss costs; only surface inside the reference silhouettes is scored."),
        ],
        tables: vec![table, chamfer_table(scored, args, cap)?],
        figures: Vec::new(),
    })
}

fn row(name: &str, depth: &DepthScore, normal: Option<&NormalScore>) -> Vec<Cell> {
    let normal = |field: fn(&NormalScore) -> f64, decimals| Cell::Value(normal.map_or(f64::NAN, field), decimals);
    vec![
        name.into(),
        Cell::Share(depth.within_1pct),
        Cell::Share(depth.within_2pct),
        Cell::Share(depth.within_5pct),
        Cell::Share(depth.coverage),
        Cell::Value(depth.median_abs_error, 4),
        Cell::Value(100.0 * depth.median_rel_error, 3),
        Cell::Value(depth.bias, 4),
        normal(|n| n.mean_angle_deg, 2),
        normal(|n| n.median_angle_deg, 2),
        normal(|n| n.mse_sum, 4),
        normal(|n| n.mse_mean, 4),
    ]
}

/// Chamfer distances of the back-projected depth maps and, if there is one, of the mesh.
fn chamfer_table(scored: &[Scored], args: &DepthArgs, cap: f64) -> Result<Table> {
    let mut table = Table::new("Object Chamfer distance", ["surface", "accuracy", "completeness", "overall"]);
    let truth: Vec<[f32; 3]> = scored.iter().flat_map(|s| back_projected(&s.reference, &s.reference_camera)).collect();
    let inside = |s: &Scored| {
        let map = DepthMap::new(&s.reference, &s.reference_camera.intrinsics);
        let own = DepthMap::new(&s.predicted, &s.camera.intrinsics);
        let mask = Grid::from_fn(s.predicted.width(), s.predicted.height(), |x, y| {
            map.lookup(map.pixel_from(Camera::pixel_centre(x, y), own.intrinsics)).is_some()
        });
        back_projected(&restricted_to(&s.predicted, &mask), &s.camera)
    };
    let points: Vec<[f32; 3]> = scored.iter().flat_map(inside).collect();
    let mut push = |name: &str, points: &[[f32; 3]]| {
        let score = object_chamfer(points, &truth, cap);
        table.push([
            name.into(),
            Cell::Value(score.accuracy, 4),
            Cell::Value(score.completeness, 4),
            Cell::Value(score.overall, 4),
        ]);
    };
    push("depth maps", &points);
    let mesh_path = args.output.join("mesh.ply");
    if mesh_path.is_file() {
        let mesh = read_ply_file(&mesh_path)?;
        // As dense as the reference is: its pixel footprint.
        let spacing = scored.iter().map(|s| footprint(&s.reference, &s.reference_camera)).fold(f64::INFINITY, f64::min);
        let sampled = sample_mesh_near(&mesh, spacing, &truth, cap);
        let kept: Vec<[f32; 3]> = sampled.into_iter().filter(|p| scored.iter().any(|s| is_inside(*p, s))).collect();
        push("mesh", &kept);
    }
    Ok(table)
}

fn footprint(depth: &Grid<f32>, camera: &Camera) -> f64 {
    let mut depths: Vec<f64> = depth.as_slice().iter().filter(|z| **z > 0.0).map(|z| f64::from(*z)).collect();
    median(&mut depths) / camera.intrinsics.mean_focal()
}

fn is_inside(point: [f32; 3], s: &Scored) -> bool {
    let world = glam::Vec3::from(point).as_dvec3();
    s.reference_camera
        .project(world)
        .is_some_and(|(pixel, _)| DepthMap::new(&s.reference, &s.reference_camera.intrinsics).lookup(pixel).is_some())
}
