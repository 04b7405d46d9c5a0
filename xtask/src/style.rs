//! Habits of the house that clippy does not know, checked over every tracked file.
//!
//! Library files open with a `//!`, no Rust file passes 600 lines, nothing is unfinished or switched off, and no
//! path of somebody's machine is committed. Invariant: only what git tracks is read.

use anyhow::{Context, Result, ensure};
use std::path::Path;
use std::process::Command;

/// Above this a file holds more than one idea.
const MAX_LINES: usize = 600;

/// Written in halves, or this file would accuse itself.
const UNFINISHED: [&str; 3] = [concat!("todo", "!("), concat!("unimplemented", "!("), concat!("#[ign", "ore")];

/// Folders at the root of people's machines.
const MACHINE_FOLDERS: [&str; 4] = ["tmp", "work", "root", "home"];

/// Every fault, as a sentence.
pub fn check(root: &Path) -> Result<Vec<String>> {
    let output = Command::new("git").args(["ls-files", "-z"]).current_dir(root).output().context("cannot run git")?;
    ensure!(output.status.success(), "git ls-files: {}", String::from_utf8_lossy(&output.stderr));
    let listed = String::from_utf8(output.stdout)?;
    let mut faults = Vec::new();
    for path in listed.split('\0').filter(|path| !path.is_empty()) {
        // A tracked file may just have been deleted, and pictures are not text.
        let text = std::fs::read(root.join(path)).ok().and_then(|bytes| String::from_utf8(bytes).ok());
        faults.extend(text.map(|text| faults_of(path, &text)).unwrap_or_default());
    }
    Ok(faults)
}

fn faults_of(path: &str, text: &str) -> Vec<String> {
    let mut faults = machine_paths(path, text);
    if !path.ends_with(".rs") {
        return faults;
    }
    if is_library_file(path) && !text.starts_with("//!") {
        faults.push(format!("{path}: does not open with a `//!` that says what it is and where it sits"));
    }
    let num_lines = text.lines().count();
    if num_lines > MAX_LINES {
        faults.push(format!("{path}: has {num_lines} lines, more than {MAX_LINES}; does it hold one idea?"));
    }
    for pattern in UNFINISHED.into_iter().filter(|pattern| text.contains(pattern)) {
        faults.push(format!("{path}: contains `{pattern}`; finish it, or delete it"));
    }
    faults
}

/// `crates/NAME/src/...`
fn is_library_file(path: &str) -> bool {
    let mut parts = path.split('/');
    parts.next() == Some("crates") && parts.nth(1) == Some("src")
}

fn machine_paths(path: &str, text: &str) -> Vec<String> {
    let faulty = |line: &str| MACHINE_FOLDERS.iter().any(|folder| names_machine_folder(line, folder));
    let lines = text.lines().enumerate().filter(|(_, line)| faulty(line));
    lines.map(|(number, _)| format!("{path}:{}: names a path of one machine", number + 1)).collect()
}

/// True when `/folder/` begins a path in `line`; `examples/folder/x` and a web address do not count.
fn names_machine_folder(line: &str, folder: &str) -> bool {
    let needle = format!("/{folder}/");
    line.match_indices(&needle).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        before.is_none_or(|c| !(c.is_alphanumeric() || "_.-".contains(c)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_file_must_open_with_its_doc() {
        assert!(faults_of("crates/a/src/b/c.rs", "//! What it is.\n").is_empty());
        assert_eq!(faults_of("crates/a/src/b/c.rs", "use x;\n//! Late.\n").len(), 1);
        assert!(faults_of("crates/a/tests/b.rs", "use x;\n").is_empty());
    }

    #[test]
    fn a_long_rust_file_is_a_fault_wherever_it_is() {
        let text = |lines: usize| format!("//! Doc.\n{}", "x\n".repeat(lines - 1));
        assert!(faults_of("crates/a/tests/b.rs", &text(MAX_LINES)).is_empty());
        assert_eq!(faults_of("crates/a/tests/b.rs", &text(MAX_LINES + 1)).len(), 1);
        assert!(faults_of("Cargo.lock", &text(MAX_LINES + 1)).is_empty());
    }

    #[test]
    fn unfinished_and_switched_off_code_is_a_fault() {
        for pattern in UNFINISHED {
            assert_eq!(faults_of("crates/a/src/b.rs", &format!("//! Doc.\n{pattern}")).len(), 1, "{pattern}");
        }
    }

    #[test]
    fn paths_of_a_machine_are_faults_and_relative_ones_are_not() {
        for folder in MACHINE_FOLDERS {
            let absolute = format!("first line\nopen(\"/{folder}/me/x.png\")");
            assert_eq!(faults_of("README.md", &absolute), ["README.md:2: names a path of one machine"]);
            let relative = format!("docs/{folder}/x.png and https://example.org/{folder}/x");
            assert!(faults_of("README.md", &relative).is_empty());
        }
    }

    #[test]
    fn no_pattern_accuses_this_file() {
        assert!(faults_of("xtask/src/style.rs", include_str!("style.rs")).is_empty());
    }
}
