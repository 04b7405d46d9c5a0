//! `surfelsplat eval synth`: methods on rendered scenes against their exact surfaces.

use super::teller;
use crate::cli::args::{parse_size, positive_length};
use crate::cli::method_args::{MethodArgs, NamedPath, named_path};
use crate::cli::publish::publish;
use crate::cli::scene_args::SceneArgs;
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;
use surfelsplat::experiments::Method;
use surfelsplat::experiments::method::DepthFrom;
use surfelsplat::experiments::synth::{SynthSettings, evaluate};
use surfelsplat::experiments::synth_report::report;

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  surfelsplat eval synth --seeds 0..6                                  six analytic scenes
  surfelsplat eval synth --assets DIR --seeds 0..20 -o out             twenty scenes of objects no training has seen
  surfelsplat eval synth --assets DIR --size 320x256,640x512 --method matching
  surfelsplat eval synth --assets DIR --method exact,matching --network small=runs/small/best.safetensors")]
pub struct SynthArgs {
    #[command(flatten)]
    scenes: SceneArgs,

    #[command(flatten)]
    methods: MethodArgs,

    /// Results of another program on the same scenes: DIR/<scene>/depth/NN.pfm and, if any, mesh.ply.
    #[arg(long, value_name = "NAME=DIR", value_parser = named_path)]
    result: Vec<NamedPath>,

    /// Sizes of the photographs.
    #[arg(long, value_name = "WxH,...", value_delimiter = ',', default_value = "320x256", value_parser = parse_size)]
    size: Vec<(usize, usize)>,

    /// What a missing or stray point costs at most, millimetres [default: 20; in rooms 10, in streets 40 times that].
    #[arg(long, value_name = "MM", value_parser = positive_length)]
    cap: Option<f64>,

    /// Distance below which a point is right, for the F-score, millimetres [default: 1, magnified alike].
    #[arg(long, value_name = "MM", value_parser = positive_length)]
    threshold: Option<f64>,

    /// Mean distance of the exact points, millimetres [default: 0.5, magnified alike].
    #[arg(long, value_name = "MM", value_parser = positive_length)]
    spacing: Option<f64>,

    /// Folder to write the report into, as Markdown and JSON.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

pub fn run(args: &SynthArgs, json: bool, quiet: bool) -> Result<ExitCode> {
    let mut methods = args.methods.methods(&["exact", "matching", "network"])?;
    methods.extend(args.result.iter().map(|NamedPath { name, path }| {
        Method::new(name, format!("results read from {}", path.display()), DepthFrom::Files(path.clone()))
    }));
    let usual = SynthSettings::new(args.scenes.seeds.0.clone(), methods).magnified(args.scenes.magnification());
    let settings = SynthSettings {
        cap: args.cap.unwrap_or(usual.cap),
        threshold: args.threshold.unwrap_or(usual.threshold),
        spacing: args.spacing.unwrap_or(usual.spacing),
        ..usual
    };
    let mut scores = Vec::new();
    for &size in &args.size {
        scores.extend(evaluate(&args.scenes.source(size)?, &settings, &teller(quiet))?);
    }
    publish(&report(&scores, &settings, &args.scenes.describe()), args.output.as_deref(), json)?;
    Ok(ExitCode::SUCCESS)
}
