//! The real binary, run once, and what it said.

use std::ffi::OsStr;
use std::path::Path;
use std::process::Command;

/// Working size of nearly all tests: the size the synthetic photographs have.
pub const SIZE: &str = "160x128";

/// Outcome of one run.
pub struct Run {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

/// Runs `surfelsplat` with these arguments.
pub fn surfelsplat<S: AsRef<OsStr>>(args: impl IntoIterator<Item = S>) -> Run {
    let output = Command::new(env!("CARGO_BIN_EXE_surfelsplat")).args(args).output().expect("the binary runs");
    Run {
        code: output.status.code(),
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

/// `surfelsplat reconstruct scene -o out` and more arguments.
pub fn reconstruct(scene: &Path, out: &Path, more: &[&str]) -> Run {
    let fixed = [OsStr::new("reconstruct"), scene.as_os_str(), OsStr::new("-o"), out.as_os_str()];
    surfelsplat(fixed.into_iter().chain(more.iter().map(OsStr::new)))
}

/// `surfelsplat inspect scene -o picture` and more arguments.
pub fn inspect(scene: &Path, picture: &Path, more: &[&str]) -> Run {
    let fixed = [OsStr::new("inspect"), scene.as_os_str(), OsStr::new("-o"), picture.as_os_str()];
    surfelsplat(fixed.into_iter().chain(more.iter().map(OsStr::new)))
}

impl Run {
    /// The run itself, which must have succeeded.
    pub fn succeeded(self, what: &str) -> Self {
        assert_eq!(self.code, Some(0), "{what}: {}", self.stderr);
        self
    }
}
