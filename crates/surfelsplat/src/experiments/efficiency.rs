//! How long a reconstruction takes, step by step, and how much memory: the paper's table 2 for this machine.
//!
//! Invariant: what is reported are repeated runs of one and the same job after a warm-up, never the first.

use super::error::ExperimentError;
use crate::reconstruct::{Options, Report as Account, Silent, Stage, reconstruct};
use std::path::Path;
use surfel_eval::depth_metrics::median;
use surfel_eval::paper_tables::TABLE_2;
use surfel_eval::report::{Cell, Report, Table};

/// Warm runs of one scene.
pub struct Timed {
    /// What to call the scene.
    pub name: String,
    /// Accounts of the runs.
    pub runs: Vec<Account>,
}

/// Reconstructs a scene `warm_up + runs` times and keeps the accounts of the last `runs`.
///
/// # Errors
/// When the road stops.
pub fn time(
    name: &str,
    scene: &Path,
    options: &Options,
    warm_up: usize,
    runs: usize,
) -> Result<Timed, ExperimentError> {
    let failed = |source| ExperimentError::File { path: std::env::temp_dir(), source };
    let out = tempfile::tempdir().map_err(failed)?;
    let run = |_| {
        reconstruct(scene, out.path(), options, &Silent)
            .map_err(|error| ExperimentError::Reconstruct { scene: name.to_owned(), source: Box::new(error) })
    };
    let mut accounts = (0..warm_up + runs).map(run).collect::<Result<Vec<_>, _>>()?;
    accounts.drain(..warm_up);
    Ok(Timed { name: name.to_owned(), runs: accounts })
}

/// What the steps of the road are called in the paper's terms.
const PARTS: [(&str, &[Stage]); 4] = [
    ("photographs to surfels", &[Stage::Features, Stage::Depth, Stage::Surfels]),
    ("rasterizer", &[Stage::Render]),
    ("meshing", &[Stage::Mesh]),
    ("reading, checking, writing", &[Stage::Read, Stage::Check, Stage::Write]),
];

/// The report of all scenes.
pub fn report(timed: &[Timed], method: &str, warm_up: usize) -> Report {
    let columns = ["scene", "part", "median s", "fastest s", "slowest s"];
    let mut parts = Table::new("Parts", columns);
    let mut stages = Table::new("Steps", columns);
    let mut memory = Table::new("Memory", ["scene", "views", "size", "threads", "runs", "peak MiB of the process"]);
    for t in timed {
        let push = |table: &mut Table, part: &str, of: &dyn Fn(&Account) -> f64| {
            let mut seconds: Vec<f64> = t.runs.iter().map(|run| of(run) / 1e3).collect();
            let (low, high) = seconds.iter().fold((f64::INFINITY, 0.0f64), |(a, b), &s| (a.min(s), b.max(s)));
            let middle = median(&mut seconds);
            table.push([
                t.name.clone().into(),
                part.into(),
                Cell::Value(middle, 3),
                Cell::Value(low, 3),
                Cell::Value(high, 3),
            ]);
        };
        for (part, of) in PARTS {
            push(&mut parts, part, &|run| run.timings.iter().filter(|x| of.contains(&x.stage)).map(|x| x.ms).sum());
        }
        push(&mut parts, "everything", &|run| run.total_ms);
        for stage in Stage::ALL {
            let name = stage.describe();
            push(&mut stages, name, &|run| run.timings.iter().filter(|x| x.stage == stage).map(|x| x.ms).sum());
        }
        if let Some(run) = t.runs.last() {
            let size = run.views.first().map_or_else(String::new, |view| format!("{}x{}", view.width, view.height));
            memory.push([
                t.name.clone().into(),
                Cell::Count(run.views.len() as u64),
                size.into(),
                Cell::Count(run.threads as u64),
                Cell::Count(t.runs.len() as u64),
                Cell::Value(run.peak_memory_mib.unwrap_or(f64::NAN), 0),
            ]);
        }
    }
    let mut paper = Table::new("The paper's table 2, on its authors' GPU", ["method", "time"]);
    TABLE_2.iter().for_each(|&(method, time)| paper.push([method.into(), time.into()]));
    Report {
        title: format!("Running time of `{method}`"),
        notes: vec![format!(
            "Wall-clock seconds of this machine, each run from files to files, after {warm_up} runs that are not \
             counted. The paper's second is its network alone on a data-centre GPU, without meshing: compare it with \
             `photographs to surfels` and `rasterizer`, and mind the machine."
        )],
        tables: vec![parts, stages, memory, paper],
        figures: Vec::new(),
    }
}
