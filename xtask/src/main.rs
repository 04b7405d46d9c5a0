//! Project checks that cargo alone does not do: `cargo xtask check-architecture`, `cargo xtask check-style`.
//!
//! Each check collects every fault before it fails, so that one run is enough to mend them all.

mod allowed_edges;
mod architecture;
mod style;

use anyhow::{Result, bail};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

fn main() -> Result<ExitCode> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let root = workspace_root();
    let (name, faults) = match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["check-architecture"] => ("architecture", architecture::check(&root)?),
        ["check-style"] => ("style", style::check(&root)?),
        _ => bail!("usage: cargo xtask check-architecture | check-style"),
    };
    if faults.is_empty() {
        println!("{name}: ok");
        return Ok(ExitCode::SUCCESS);
    }
    faults.iter().for_each(|fault| eprintln!("{fault}"));
    eprintln!("{name}: {} fault(s)", faults.len());
    Ok(ExitCode::FAILURE)
}

fn workspace_root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().map(Path::to_owned).unwrap_or_default()
}
