//! Fails when a crate uses one of ours that `ARCHITECTURE.md` does not allow it, or pulls in burn.
//!
//! Edges come from `cargo metadata`, trees from `cargo tree`. Invariant: a crate without a row and a row
//! without a crate are faults too, so the document cannot fall behind.

use crate::allowed_edges::{self, Allowed};
use anyhow::{Context, Result, ensure};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

/// What tests and benches of any crate may use besides its own row.
const FOR_TESTS: [&str; 2] = ["surfel-synth", "surfel-io"];

/// One dependency between two crates of the workspace.
#[derive(Debug, PartialEq)]
struct Edge {
    from: String,
    to: String,
    for_tests: bool,
}

/// Every fault, as a sentence.
pub fn check(root: &Path) -> Result<Vec<String>> {
    let document = std::fs::read_to_string(root.join("ARCHITECTURE.md")).context("cannot read ARCHITECTURE.md")?;
    let allowed = allowed_edges::parse(&document)?;
    let metadata = cargo(root, &["metadata", "--no-deps", "--format-version", "1"])?;
    let (crates, edges) = workspace_edges(&serde_json::from_str(&metadata)?);
    let mut faults = edge_faults(&allowed, &crates, &edges);
    for name in crates.iter().filter(|name| allowed.get(*name).is_some_and(|allowed| !allowed.burn)) {
        let tree = cargo(root, &["tree", "--package", name, "--edges", "normal", "--prefix", "none"])?;
        faults.extend(burn_fault(name, &tree));
    }
    Ok(faults)
}

fn cargo(root: &Path, arguments: &[&str]) -> Result<String> {
    let program = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let output = Command::new(program).args(arguments).current_dir(root).output().context("cannot run cargo")?;
    let stderr = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "cargo {}: {stderr}", arguments.join(" "));
    Ok(String::from_utf8(output.stdout)?)
}

/// The crates of the workspace and the edges between them.
fn workspace_edges(metadata: &Value) -> (BTreeSet<String>, Vec<Edge>) {
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let name = |value: &Value| value["name"].as_str().unwrap_or_default().to_owned();
    let packages = list(&metadata["packages"]);
    let crates: BTreeSet<String> = packages.iter().map(name).collect();
    let edges = packages
        .iter()
        .flat_map(|package| list(&package["dependencies"]).into_iter().map(move |to| (name(package), to)))
        .filter(|(_, to)| crates.contains(&name(to)))
        .map(|(from, to)| Edge { from, to: name(&to), for_tests: to["kind"].as_str() == Some("dev") })
        .collect();
    (crates, edges)
}

fn edge_faults(allowed: &BTreeMap<String, Allowed>, crates: &BTreeSet<String>, edges: &[Edge]) -> Vec<String> {
    let mut faults = Vec::new();
    for name in crates.iter().filter(|name| !allowed.contains_key(*name)) {
        faults.push(format!("{name} has no row in the table of ARCHITECTURE.md"));
    }
    for (name, row) in allowed {
        for unknown in row.uses.iter().chain([name]).filter(|used| !crates.contains(*used)) {
            faults.push(format!("ARCHITECTURE.md names {unknown}, which is no crate of the workspace"));
        }
    }
    for Edge { from, to, for_tests } in edges {
        let in_row = allowed.get(from).is_none_or(|row| row.uses.contains(to));
        let by_tests = *for_tests && FOR_TESTS.contains(&to.as_str());
        if !(in_row || by_tests) {
            let what = if *for_tests { "its tests use" } else { "it uses" };
            faults.push(format!("{from}: {what} {to}, which ARCHITECTURE.md does not allow"));
        }
    }
    faults
}

fn burn_fault(name: &str, tree: &str) -> Option<String> {
    let packages = tree.lines().filter_map(|line| line.split_whitespace().next());
    let found = packages.into_iter().find(|package| *package == "burn" || package.starts_with("burn-"))?;
    Some(format!("{name}: its default build contains {found}, and ARCHITECTURE.md says it has no burn"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn row(uses: &[&str]) -> Allowed {
        Allowed { uses: uses.iter().map(|&name| name.to_owned()).collect(), burn: false }
    }

    fn names(list: &[&str]) -> BTreeSet<String> {
        list.iter().map(|&name| name.to_owned()).collect()
    }

    fn edge(from: &str, to: &str, for_tests: bool) -> Edge {
        Edge { from: from.to_owned(), to: to.to_owned(), for_tests }
    }

    #[test]
    fn reads_edges_of_the_workspace_only() {
        let metadata = json!({ "packages": [
            { "name": "a", "dependencies": [{ "name": "glam", "kind": null }, { "name": "b", "kind": "dev" }] },
            { "name": "b", "dependencies": [{ "name": "a", "kind": null }] },
        ] });
        let (crates, edges) = workspace_edges(&metadata);
        assert_eq!(crates, names(&["a", "b"]));
        assert_eq!(edges, [edge("a", "b", true), edge("b", "a", false)]);
    }

    #[test]
    fn a_forbidden_edge_is_a_fault_and_an_allowed_one_is_not() {
        let allowed = BTreeMap::from([("a".to_owned(), row(&["b"])), ("b".to_owned(), row(&[]))]);
        let crates = names(&["a", "b"]);
        assert!(edge_faults(&allowed, &crates, &[edge("a", "b", false)]).is_empty());
        let faults = edge_faults(&allowed, &crates, &[edge("b", "a", false)]);
        assert_eq!(faults, ["b: it uses a, which ARCHITECTURE.md does not allow"]);
    }

    #[test]
    fn only_tests_may_reach_for_the_synthetic_scenes() {
        let allowed = BTreeMap::from([("a".to_owned(), row(&[])), ("surfel-synth".to_owned(), row(&[]))]);
        let crates = names(&["a", "surfel-synth"]);
        assert!(edge_faults(&allowed, &crates, &[edge("a", "surfel-synth", true)]).is_empty());
        assert_eq!(edge_faults(&allowed, &crates, &[edge("a", "surfel-synth", false)]).len(), 1);
    }

    #[test]
    fn a_missing_row_and_an_unknown_crate_are_faults() {
        let allowed = BTreeMap::from([("a".to_owned(), row(&["gone"]))]);
        let faults = edge_faults(&allowed, &names(&["a", "new"]), &[]);
        assert!(faults[0].contains("new has no row"), "{faults:?}");
        assert!(faults[1].contains("names gone"), "{faults:?}");
    }

    #[test]
    fn burn_is_found_in_a_tree_and_its_namesakes_are_not() {
        assert_eq!(burn_fault("a", "a v0.1.0\nglam v0.34.2\nburning v1.0.0"), None);
        assert!(burn_fault("a", "a v0.1.0\nburn-flex v0.22.1").is_some());
        assert!(burn_fault("a", "a v0.1.0\nburn v0.22.1").is_some());
    }
}
