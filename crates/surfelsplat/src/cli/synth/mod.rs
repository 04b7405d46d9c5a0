//! `surfelsplat synth`: rendered scenes to look at, to check and to keep.

mod export;
mod sheet;
mod verify;

use anyhow::Result;
use clap::Subcommand;
use std::process::ExitCode;

/// What can be done with rendered scenes.
#[derive(Debug, Subcommand)]
pub enum SynthCommand {
    /// Draw one page with pictures, depth and normals of many scenes.
    Sheet(sheet::SheetArgs),
    /// Warp views into each other by their exact depth; exit code 1 when they disagree.
    Verify(verify::VerifyArgs),
    /// Write scenes as folders with photographs, cameras and everything that is true of them.
    Export(export::ExportArgs),
}

/// Runs one of them.
pub fn run(command: &SynthCommand, json: bool, quiet: bool) -> Result<ExitCode> {
    match command {
        SynthCommand::Sheet(args) => sheet::run(args, json, quiet),
        SynthCommand::Verify(args) => verify::run(args, json),
        SynthCommand::Export(args) => export::run(args, json, quiet),
    }
}
