//! `surfelsplat synth export`: rendered scenes as folders that any command, and any peer, can open.

use crate::cli::args::{parse_size, positive_length};
use crate::cli::print_line;
use crate::cli::scene_args::SceneArgs;
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;
use surfelsplat::experiments::export::write_scene;
use surfelsplat::experiments::synth::SPACING;

#[derive(Debug, Args)]
#[command(after_help = "\
Each scene becomes OUT/<name>/ with images/, cameras.json, depth/*.pfm (z-depth), normal/*.pfm (camera frame),
label/*.png (object per pixel), truth/points.ply (exact points on the objects) and truth/objects.ply. Millimetres.

Example:
  surfelsplat synth export --assets DIR --seeds 0..4 -o scenes
  surfelsplat reconstruct scenes/val-0 -o out
  surfelsplat eval depth scenes/val-0 out")]
pub struct ExportArgs {
    #[command(flatten)]
    scenes: SceneArgs,

    /// Size of the photographs.
    #[arg(long, value_name = "WxH", default_value = "320x256", value_parser = parse_size)]
    size: (usize, usize),

    /// Mean distance of the exact points, millimetres [default: 0.5; in rooms 10, in streets 40 times that].
    #[arg(long, value_name = "MM", value_parser = positive_length)]
    spacing: Option<f64>,

    /// Write mask/ too: white on the objects. Whoever opens the scene will then look at the objects only.
    #[arg(long)]
    masks: bool,

    /// Folder to write the scenes into.
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
}

pub fn run(args: &ExportArgs, json: bool, quiet: bool) -> Result<ExitCode> {
    let source = args.scenes.source(args.size)?;
    let spacing = args.spacing.unwrap_or(SPACING * args.scenes.magnification());
    let mut folders = Vec::new();
    for &seed in &args.scenes.seeds.0 {
        let scene = source.scene(seed, spacing)?;
        let folder = args.output.join(&scene.name);
        write_scene(&scene, &folder, args.masks)?;
        if !json && !quiet {
            print_line(&format!("{}: {} exact points", folder.display(), scene.surface.points.len()));
        }
        folders.push(folder);
    }
    if json {
        print_line(&serde_json::json!({ "scenes": folders }).to_string());
    }
    Ok(ExitCode::SUCCESS)
}
