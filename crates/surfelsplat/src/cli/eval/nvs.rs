//! `surfelsplat eval nvs`: held-out photographs against what the surfels show there.

use crate::cli::args::parse_size;
use crate::cli::publish::publish;
use anyhow::{Result, bail};
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;
use surfel_io::scene::Scene;
use surfelsplat::experiments::dtu::inputs_of;
use surfelsplat::experiments::nvs::{read_surfels, report, score_targets};

#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  surfelsplat reconstruct scene --views 33,31 --size 320x256 -o out
  surfelsplat eval nvs scene out --targets 32,24,23,44 -o report")]
pub struct NvsArgs {
    /// The scene: photographs and cameras.
    scene: PathBuf,

    /// Result folder with surfels.ply, or a splat PLY.
    result: PathBuf,

    /// Photographs to compare with, by name, stem or number (default: all that the result was not made from).
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    targets: Vec<String>,

    /// Size of the renderings (default: as reconstruct chooses it).
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<(usize, usize)>,

    /// Folder to write the report and the pictures into.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

pub fn run(args: &NvsArgs, json: bool) -> Result<ExitCode> {
    let scene = Scene::open(&args.scene)?;
    let surfels = read_surfels(&args.result)?;
    let targets: Vec<usize> = if args.targets.is_empty() {
        let inputs = scene.select(&inputs_of(&args.result)?)?;
        (0..scene.frames.len()).filter(|frame| !inputs.contains(frame)).collect()
    } else {
        scene.select(&args.targets)?
    };
    if targets.is_empty() {
        bail!(
            "{} has no photograph that {} was not made from; name targets with --targets",
            args.scene.display(),
            args.result.display()
        );
    }
    let scores = score_targets(&surfels, &scene, &targets, args.size, None)?;
    publish(&report(&scores, &args.result.display().to_string(), None), args.output.as_deref(), json)?;
    Ok(ExitCode::SUCCESS)
}
