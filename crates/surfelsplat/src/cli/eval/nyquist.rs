//! `surfelsplat eval nyquist`: the paper's verification of its criterion, as histograms.

use super::teller;
use crate::cli::args::{parse_size, positive_length};
use crate::cli::method_args::MethodArgs;
use crate::cli::publish::publish;
use crate::cli::scene_args::SceneArgs;
use anyhow::{Context, Result, bail};
use clap::Args;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use surfelsplat::experiments::export::{stem, write_inputs};
use surfelsplat::experiments::nyquist::{SurfelStates, report};
use surfelsplat::reconstruct::{Options, Walked};

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  surfelsplat eval nyquist my_scene --views 23,24 --size 320x256 -o out    photographs in millimetres
  surfelsplat eval nyquist --assets DIR --seeds 0..10 -o out               rendered scenes")]
pub struct NyquistArgs {
    /// Scene folders or camera files (default: rendered scenes).
    scene: Vec<PathBuf>,

    /// Photographs to use of each scene, by name, stem or number (default: the best pair).
    #[arg(long, value_name = "A,B,...", value_delimiter = ',', requires = "scene")]
    views: Vec<String>,

    /// Millimetres in a unit of the scenes; the literal reading of the paper needs them.
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = positive_length)]
    mm_per_unit: f64,

    #[command(flatten)]
    methods: MethodArgs,

    /// Working size of the photographs.
    #[arg(long, value_name = "WxH", default_value = "320x256", value_parser = parse_size)]
    size: (usize, usize),

    #[command(flatten)]
    rendered: SceneArgs,

    /// Folder to write the report and the plot into.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

pub fn run(args: &NyquistArgs, json: bool, quiet: bool) -> Result<ExitCode> {
    let method = args.methods.one("matching")?;
    let options = Options { size: Some(args.size), views: args.views.clone(), ..Options::default() };
    let Some(options) = method.options(&options) else {
        bail!("--method {} makes no surfels; name one that reconstructs", method.name);
    };
    let tell = teller(quiet);
    let mut states = SurfelStates::default();
    let mut add = |name: &str, scene: &Path, options: &Options| -> Result<()> {
        tell(&format!("{name}: {}", method.name));
        let (walked, _) = Walked::without_writing(scene, options).with_context(|| name.to_owned())?;
        states.extend(SurfelStates::of(&walked, options, args.mm_per_unit));
        Ok(())
    };
    for scene in &args.scene {
        add(&scene.display().to_string(), scene, &options)?;
    }
    let mut described: Vec<String> = args.scene.iter().map(|scene| scene.display().to_string()).collect();
    if args.scene.is_empty() {
        let source = args.rendered.source(args.size)?;
        described.push(args.rendered.describe());
        for &seed in &args.rendered.seeds.0 {
            let folder = tempfile::tempdir()?;
            let views = source.views(seed)?;
            write_inputs(&views, folder.path())?;
            let options = Options { views: (0..views.len()).map(stem).collect(), ..options.clone() };
            add(&source.name(seed), folder.path(), &options)?;
        }
    }
    let described = format!("{}, {}x{} pixels, `{}`", described.join("; "), args.size.0, args.size.1, method.name);
    publish(&report(&states, &options, &described, args.mm_per_unit), args.output.as_deref(), json)?;
    Ok(ExitCode::SUCCESS)
}
