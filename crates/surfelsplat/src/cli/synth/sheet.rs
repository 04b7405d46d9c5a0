//! `surfelsplat synth sheet`: a contact sheet of rendered scenes.

use crate::cli::args::{parse_size, positive};
use crate::cli::print_line;
use crate::cli::scene_args::SceneArgs;
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;
use surfel_io::write::picture_png::write_rgb_png;
use surfel_io::write::write_atomically;
use surfel_synth::contact_sheet::{contact_sheet, depth_tile, normal_tile};

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  surfelsplat synth sheet -o sheet.png                                          analytic scenes
  surfelsplat synth sheet --assets DIR --split train --seeds 0..12 --defects -o sheet.png")]
pub struct SheetArgs {
    #[command(flatten)]
    scenes: SceneArgs,

    /// Size of each picture.
    #[arg(long, value_name = "WxH", default_value = "320x256", value_parser = parse_size)]
    size: (usize, usize),

    /// Scenes side by side.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = positive)]
    columns: usize,

    /// PNG to write.
    #[arg(short, long, value_name = "PNG")]
    output: PathBuf,
}

pub fn run(args: &SheetArgs, json: bool, quiet: bool) -> Result<ExitCode> {
    let source = args.scenes.source(args.size)?;
    let mut tiles = Vec::new();
    let mut names = Vec::new();
    for &seed in &args.scenes.seeds.0 {
        names.push(source.name(seed));
        let views = source.views(seed)?;
        let truth = views.first().map(|view| [depth_tile(&view.depth), normal_tile(&view.normal)]);
        tiles.extend(views.into_iter().map(|view| view.view.image).chain(truth.into_iter().flatten()));
    }
    let per_scene = args.scenes.views_per_scene + 2;
    let sheet = contact_sheet(&tiles, per_scene * args.columns);
    write_atomically(&args.output, |out| write_rgb_png(out, &sheet))?;
    if json {
        print_line(&serde_json::json!({ "picture": args.output, "scenes": names }).to_string());
    } else if !quiet {
        let each = "per scene its photographs, then depth and normals of the first";
        print_line(&format!("{}: {} ({each})", args.output.display(), names.join(", ")));
    }
    Ok(ExitCode::SUCCESS)
}
