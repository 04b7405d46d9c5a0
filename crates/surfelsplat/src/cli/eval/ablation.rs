//! `surfelsplat eval ablation`: a method and the same without one part, on rendered scenes.

use super::teller;
use crate::cli::args::{parse_size, positive_length};
use crate::cli::method_args::MethodArgs;
use crate::cli::publish::publish;
use crate::cli::scene_args::SceneArgs;
use anyhow::{Result, bail};
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;
use surfelsplat::experiments::ablation::report;
use surfelsplat::experiments::method::ABLATION;
use surfelsplat::experiments::synth::{SynthSettings, evaluate};

#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  surfelsplat eval ablation --assets DIR --seeds 0..20 -o out
  surfelsplat eval ablation --assets DIR --network whole=a.safetensors --network \"without aggregation=b.safetensors\"

By default the network that ships is compared with itself without a part, not retrained. To compare equal budgets,
give networks: one without a part is trained without it, for the same number of steps; each file says how it was trained
(surfelsplat weights info).")]
pub struct AblationArgs {
    #[command(flatten)]
    scenes: SceneArgs,

    #[command(flatten)]
    methods: MethodArgs,

    /// Sizes of the photographs.
    #[arg(long, value_name = "WxH,...", value_delimiter = ',', default_value = "320x256", value_parser = parse_size)]
    size: Vec<(usize, usize)>,

    /// Mean distance of the exact points, millimetres [default: 0.5; in rooms 10, in streets 40 times that].
    #[arg(long, value_name = "MM", value_parser = positive_length)]
    spacing: Option<f64>,

    /// Folder to write the report into.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

pub fn run(args: &AblationArgs, json: bool, quiet: bool) -> Result<ExitCode> {
    let methods = args.methods.methods(&ABLATION)?;
    if methods.len() < 2 {
        bail!("an ablation compares at least two methods: the whole and the same without a part");
    }
    let usual = SynthSettings::new(args.scenes.seeds.0.clone(), methods).magnified(args.scenes.magnification());
    let settings = SynthSettings { spacing: args.spacing.unwrap_or(usual.spacing), ..usual };
    let mut scores = Vec::new();
    for &size in &args.size {
        scores.extend(evaluate(&args.scenes.source(size)?, &settings, &teller(quiet))?);
    }
    publish(&report(&scores, &settings, &args.scenes.describe()), args.output.as_deref(), json)?;
    Ok(ExitCode::SUCCESS)
}
