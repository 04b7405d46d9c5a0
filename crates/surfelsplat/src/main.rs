//! The `surfelsplat` command: parses, runs one command, maps its outcome to an exit code.
//!
//! 0 = done, 1 = failed with a sentence on stderr, 2 = the command line was wrong (clap's own).

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    surfel_net::keep_freed_memory();
    cli::run()
}
