//! `surfelsplat eval`: one file per experiment, each a thin layer of flags over `surfelsplat::experiments`.

mod ablation;
mod depth;
mod dtu;
mod efficiency;
mod nvs;
mod nyquist;
mod synth;

use anyhow::Result;
use clap::Subcommand;
use std::process::ExitCode;

/// The experiments.
#[derive(Debug, Subcommand)]
pub enum EvalCommand {
    /// Score the depth maps of a reconstruction against a scene's reference depth.
    Depth(depth::DepthArgs),
    /// Reconstruct rendered scenes and score them against their exact surfaces.
    Synth(synth::SynthArgs),
    /// Score meshes by the DTU protocol, culled as published figures are.
    Dtu(dtu::DtuArgs),
    /// Compare new views rendered from surfels with photographs held out.
    Nvs(nvs::NvsArgs),
    /// Count the surfels that obey the Nyquist criterion, before and after adaptation.
    Nyquist(nyquist::NyquistArgs),
    /// Leave one part of a method out and score it on rendered scenes.
    Ablation(ablation::AblationArgs),
    /// Time every step of a reconstruction, warm, and its peak memory.
    Efficiency(efficiency::EfficiencyArgs),
}

/// Runs one of them.
pub fn run(command: &EvalCommand, json: bool, quiet: bool) -> Result<ExitCode> {
    match command {
        EvalCommand::Depth(args) => depth::run(args, json),
        EvalCommand::Dtu(args) => dtu::run(args, json, quiet),
        EvalCommand::Synth(args) => synth::run(args, json, quiet),
        EvalCommand::Nvs(args) => nvs::run(args, json),
        EvalCommand::Ablation(args) => ablation::run(args, json, quiet),
        EvalCommand::Efficiency(args) => efficiency::run(args, json, quiet),
        EvalCommand::Nyquist(args) => nyquist::run(args, json, quiet),
    }
}

/// Says on stderr what a long run is doing, unless asked to be quiet.
fn teller(quiet: bool) -> impl Fn(&str) {
    move |line| {
        if !quiet {
            eprintln!("{line}");
        }
    }
}
