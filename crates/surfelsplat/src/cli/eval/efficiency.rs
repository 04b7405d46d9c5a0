//! `surfelsplat eval efficiency`: warm running times of every step, and peak memory.

use super::teller;
use crate::cli::args::{parse_size, positive};
use crate::cli::method_args::MethodArgs;
use crate::cli::publish::publish;
use anyhow::{Result, bail};
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;
use surfelsplat::experiments::efficiency::{report, time};
use surfelsplat::reconstruct::Options;

#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  surfelsplat eval efficiency my_scene --views 23,24 --size 320x256 --runs 10 -o out")]
pub struct EfficiencyArgs {
    /// Scene folders or camera files.
    #[arg(required = true)]
    scene: Vec<PathBuf>,

    /// Photographs to use of each scene, by name, stem or number (default: the best pair).
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    views: Vec<String>,

    #[command(flatten)]
    methods: MethodArgs,

    /// Working size of the photographs.
    #[arg(long, value_name = "WxH", default_value = "320x256", value_parser = parse_size)]
    size: (usize, usize),

    /// Runs that count.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = positive)]
    runs: usize,

    /// Runs before them that do not.
    #[arg(long, value_name = "N", default_value_t = 1)]
    warm_up: usize,

    /// Folder to write the report into.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

pub fn run(args: &EfficiencyArgs, json: bool, quiet: bool) -> Result<ExitCode> {
    let method = args.methods.one("matching")?;
    let options = Options { size: Some(args.size), views: args.views.clone(), ..Options::default() };
    let Some(options) = method.options(&options) else {
        bail!("--method {} takes no time; name one that reconstructs", method.name);
    };
    let mut timed = Vec::new();
    for scene in &args.scene {
        let name = scene.display().to_string();
        teller(quiet)(&format!("{name}: {} runs", args.warm_up + args.runs));
        timed.push(time(&name, scene, &options, args.warm_up, args.runs)?);
    }
    publish(&report(&timed, &method.name, args.warm_up), args.output.as_deref(), json)?;
    Ok(ExitCode::SUCCESS)
}
