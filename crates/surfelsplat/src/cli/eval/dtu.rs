//! `surfelsplat eval dtu`: the official mesh benchmark on any meshes, or its arithmetic on a scene's own points.

use crate::cli::eval::teller;
use crate::cli::publish::publish;
use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use surfel_eval::Reference;
use surfel_eval::cull::Cull;
use surfel_eval::dtu::DtuReference;
use surfel_io::ply::read_ply_file;
use surfel_io::scene::Scene;
use surfelsplat::experiments::dtu::{Candidate, Ground, inputs_of, mesh_path, scan_of, score_candidate};
use surfelsplat::experiments::dtu_report::{GroundName, report};

/// Which parts of a mesh are scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum CullName {
    /// What falls on the grown masks of all photographs.
    Dense,
    /// What the input photographs see inside their masks.
    Sparse,
    /// All of it.
    None,
}

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  surfelsplat eval dtu out/scan24 out/scan37 --data DTU --scenes DTU_NEUS -o report
      DTU holds Points/stl and ObsMask; DTU_NEUS holds scan24/, scan37/ with cameras*.npz, image/ and mask/
  surfelsplat eval dtu meshes/scan24.ply --data DTU --cull none
  surfelsplat eval dtu out --scenes dtu_scan24
      without --data: against the scene's own reference points; not comparable with the paper")]
pub struct DtuArgs {
    /// Result folders (with mesh.ply) or PLY meshes, in millimetres in the frame of the scans.
    #[arg(required = true)]
    result: Vec<PathBuf>,

    /// Folder with the official Points/stl/ and ObsMask/.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,

    /// Folder with the scans' cameras, photographs and masks: scan24/, scan37/, ... or one such scene.
    #[arg(long, value_name = "DIR")]
    scenes: Option<PathBuf>,

    /// Number of the scan, when the paths do not say it.
    #[arg(long, value_name = "N")]
    scan: Option<u32>,

    /// Culling rules (default: dense and sparse with --scenes, else none).
    #[arg(long, value_enum, value_delimiter = ',')]
    cull: Vec<CullName>,

    /// Photographs the meshes were made from, for sparse culling (default: those in the results' cameras.json).
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    views: Vec<String>,

    /// Folder to write the report into.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

pub fn run(args: &DtuArgs, json: bool, quiet: bool) -> Result<ExitCode> {
    let mut results = Vec::new();
    let mut origin = GroundName::Official;
    for path in &args.result {
        let candidate = candidate(path, args)?;
        teller(quiet)(&format!("{}: scan {}", path.display(), candidate.scan));
        let scene = args.scenes.as_deref().map(|folder| scene_of(folder, candidate.scan)).transpose()?;
        let ground = match &args.data {
            Some(data) => Ground::Official(Box::new(DtuReference::open(data, candidate.scan)?)),
            None => {
                let (ground, name) = own_points(scene.as_ref())?;
                origin = GroundName::Points(name);
                ground
            }
        };
        results.extend(score_candidate(&candidate, &ground, &rules(args, &candidate), scene.as_ref())?);
    }
    publish(&report(&results, &origin), args.output.as_deref(), json)?;
    Ok(ExitCode::SUCCESS)
}

fn candidate(path: &Path, args: &DtuArgs) -> Result<Candidate> {
    let scan = args.scan.or_else(|| scan_of(path)).or_else(|| args.scenes.as_deref().and_then(scan_of));
    let Some(scan) = scan else {
        bail!("{}: which scan is this? The path does not say it; name it with --scan", path.display());
    };
    let inputs = if args.views.is_empty() { inputs_of(path)? } else { args.views.clone() };
    let mesh = read_ply_file(&mesh_path(path))?;
    if mesh.triangles.is_empty() {
        bail!("{} has no triangles; the protocol scores meshes", mesh_path(path).display());
    }
    Ok(Candidate { name: path.display().to_string(), scan, mesh, inputs })
}

/// The scene of a scan: a folder of that name below `folder`, or `folder` itself.
fn scene_of(folder: &Path, scan: u32) -> Result<Scene> {
    let names = [format!("scan{scan}"), format!("dtu_scan{scan}")];
    let below = names.iter().map(|name| folder.join(name)).find(|path| path.is_dir());
    let path = below.unwrap_or_else(|| folder.to_owned());
    Scene::open(&path).with_context(|| format!("the cameras and masks of scan {scan}"))
}

fn own_points(scene: Option<&Scene>) -> Result<(Ground, String)> {
    let Some(scene) = scene else {
        bail!(
            "there is nothing to compare with: give the official data (--data), or a scene with reference points (--scenes)"
        );
    };
    let reference = Reference::open(&scene.root)?;
    let Some(points) = reference.and_then(|reference| reference.points().transpose()).transpose()? else {
        bail!("{} has no reference points, and no --data was given", scene.root.display());
    };
    let kind = if scene.root.join("pseudo_gt").is_dir() {
        "multi-view-stereo points computed from this scene's own photographs"
    } else {
        "the exact points of this rendered scene"
    };
    let name = format!("{kind} ({}, {} points)", scene.root.display(), points.positions.len());
    Ok((Ground::Points(points.positions), name))
}

fn rules(args: &DtuArgs, candidate: &Candidate) -> Vec<Cull> {
    if args.cull.is_empty() {
        return match (&args.scenes, candidate.inputs.is_empty()) {
            (None, _) => vec![Cull::None],
            (Some(_), true) => vec![Cull::Dense],
            (Some(_), false) => vec![Cull::Dense, Cull::Sparse],
        };
    }
    let rule = |name: &CullName| match name {
        CullName::Dense => Cull::Dense,
        CullName::Sparse => Cull::Sparse,
        CullName::None => Cull::None,
    };
    args.cull.iter().map(rule).collect()
}
