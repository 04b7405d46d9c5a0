//! The command line: arguments in, one command run, sentences out.
//!
//! Results go to stdout, talk to stderr. Invariant: parsing opens no file, and nothing but this folder prints.

mod args;
mod console;
mod device;
mod eval;
mod inspect;
mod method_args;
mod publish;
mod reconstruct;
mod scene_args;
mod synth;
mod train;
mod weights;

use args::{Cli, Command};
use clap::Parser;
use std::io::Write;
use std::process::ExitCode;

/// Parses the command line and runs it.
pub fn run() -> ExitCode {
    let cli = Cli::parse();
    if let Some(threads) = cli.threads {
        // Fails only when a pool exists already, which is never the case here.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    }
    let json = cli.json;
    let result = match cli.command {
        Command::Reconstruct(ref args) => reconstruct::run(args, cli.json, cli.quiet),
        Command::Inspect(ref args) => inspect::run(args, cli.json, cli.quiet),
        Command::Device(ref args) => device::run(args, cli.json, cli.quiet),
        Command::Train(ref args) => train::run(args, cli.json, cli.quiet),
        Command::Eval { ref command } => eval::run(command, cli.json, cli.quiet),
        Command::Synth { ref command } => synth::run(command, cli.json, cli.quiet),
        Command::Weights { ref command } => weights::run(command, cli.json, cli.quiet),
    };
    match result {
        Ok(code) => code,
        Err(error) => {
            let sentence = sentence(&error);
            if json {
                print_line(&serde_json::json!({ "error": sentence }).to_string());
            }
            eprintln!("surfelsplat: {sentence}");
            ExitCode::from(1)
        }
    }
}

/// The error and its causes, except those whose words it repeats already.
fn sentence(error: &anyhow::Error) -> String {
    error.chain().skip(1).map(ToString::to_string).fold(error.to_string(), |said, cause| match said.contains(&cause) {
        true => said,
        false => format!("{said}: {cause}"),
    })
}

/// Prints to stdout; a closed pipe (`| head`) is not an error.
fn print_line(line: &str) {
    let _ = writeln!(std::io::stdout().lock(), "{line}");
}
