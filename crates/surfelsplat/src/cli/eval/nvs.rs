//! `surfelsplat eval nvs`: held-out photographs against what the surfels show there.

use crate::cli::args::parse_size;
use crate::cli::publish::publish;
use anyhow::{Result, bail};
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;
use surfel_core::Grid;
use surfel_io::scene::Scene;
use surfel_loss::Lpips;
use surfel_net::Device;
use surfelsplat::experiments::dtu::inputs_of;
use surfelsplat::experiments::nvs::{Perceptual, read_surfels, report, score_targets};

/// sRGB in \[0, 1\].
type Picture = Grid<[f32; 3]>;

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

    /// Weights of LPIPS, measured besides PSNR and SSIM (docs/lpips.md says how to make them).
    #[arg(long, value_name = "FILE")]
    lpips: Option<PathBuf>,

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
    let lpips = args.lpips.as_ref().map(|path| Lpips::from_file(path, &Device::flex())).transpose()?;
    let distance = lpips.as_ref().map(|lpips| |a: &Picture, b: &Picture| lpips.of_pictures(a, b));
    let perceptual = distance.as_ref().map(|distance| Perceptual { name: "LPIPS", distance });
    let scores = score_targets(&surfels, &scene, &targets, args.size, perceptual.as_ref())?;
    let report = report(&scores, &args.result.display().to_string(), perceptual.as_ref());
    publish(&report, args.output.as_deref(), json)?;
    Ok(ExitCode::SUCCESS)
}
