//! `surfelsplat synth verify`: do rendered views agree with each other?

use crate::cli::args::parse_size;
use crate::cli::publish::publish;
use crate::cli::scene_args::SceneArgs;
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;
use surfelsplat::experiments::verify::{WarpLimits, verify};

#[derive(Debug, Args)]
pub struct VerifyArgs {
    #[command(flatten)]
    scenes: SceneArgs,

    /// Size of the pictures.
    #[arg(long, value_name = "WxH", default_value = "320x256", value_parser = parse_size)]
    size: (usize, usize),

    /// Largest median colour difference that passes, sRGB units in [0, 1].
    #[arg(long, value_name = "X", default_value_t = WarpLimits::default().median)]
    max_median: f32,

    /// Folder to write the report into.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

pub fn run(args: &VerifyArgs, json: bool) -> Result<ExitCode> {
    let limits = WarpLimits { median: args.max_median, ..WarpLimits::default() };
    let (report, faults) = verify(&args.scenes.source(args.size)?, &args.scenes.seeds.0, &limits)?;
    publish(&report, args.output.as_deref(), json)?;
    faults.iter().for_each(|fault| eprintln!("surfelsplat: {fault}"));
    Ok(ExitCode::from(u8::from(!faults.is_empty())))
}
