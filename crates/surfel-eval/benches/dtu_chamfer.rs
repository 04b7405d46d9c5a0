//! The DTU protocol against its scipy twin (`bench/peers/dtu_chamfer.py`) on one scan, measured in the same run.
//!
//! `cargo bench -p surfel-eval --bench dtu_chamfer`; SURFELSPLAT_PYTHON names a Python with numpy and scipy. Both use all
//! cores and run in turn; each is represented by its fastest run.

use std::path::Path;
use std::process::Command;
use std::time::Instant;
use surfel_core::TriMesh;
use surfel_eval::dtu::{DtuReference, DtuScore, DtuSettings, score_dtu};

const CELLS: u32 = 200;
const RUNS: usize = 3;

fn main() {
    let folder = std::env::temp_dir().join("surfel_eval_bench_dtu");
    let mesh = toy_mesh(CELLS);
    let (mut ours, mut theirs) = (f64::INFINITY, f64::INFINITY);
    let mut last: Option<(DtuScore, f64)> = None;
    for _ in 0..RUNS {
        let Some(peer) = scipy(&folder) else { return };
        let reference = DtuReference::open(&folder, 1).expect("the peer wrote the scan");
        let start = Instant::now();
        let score = score_dtu(&mesh, &reference, &DtuSettings::default());
        ours = ours.min(start.elapsed().as_secs_f64());
        theirs = theirs.min(peer["seconds"].as_f64().expect("seconds"));
        last = Some((score, peer["overall"].as_f64().expect("overall")));
    }
    let Some((score, overall)) = last else { return };
    println!("{} points: ours {ours:.2} s, scipy {theirs:.2} s, ratio {:.1}", score.num_data_points, theirs / ours);
    println!("overall: ours {:.6} mm, scipy {overall:.6} mm", score.overall);
}

/// Writes the scan and scores it; `None`, said aloud, where Python or scipy is missing.
fn scipy(folder: &Path) -> Option<serde_json::Value> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bench/peers/dtu_chamfer.py");
    let python = std::env::var("SURFELSPLAT_PYTHON").unwrap_or_else(|_| "python3".into());
    let output = Command::new(&python).arg(script).args(["--toy", &CELLS.to_string()]).arg(folder).output();
    match output {
        Ok(output) if output.status.success() => serde_json::from_slice(&output.stdout).ok(),
        _ => {
            eprintln!("SKIPPED: `{python}` cannot run the scipy peer; set SURFELSPLAT_PYTHON");
            None
        }
    }
}

/// The mesh of the script's toy (its rule is tested in `tests/dtu_toy.rs`).
fn toy_mesh(n: u32) -> TriMesh {
    let side = 0.75 * f64::from(n);
    let vertex = |i: u32| {
        let (x, y) = (f64::from(i % (n + 1)) * side / f64::from(n), f64::from(i / (n + 1)) * side / f64::from(n));
        [x as f32, y as f32, (0.01 * x * x - 0.02 * x * y + 0.3 * y) as f32]
    };
    let cells: Vec<u32> = (0..n * n).map(|i| i / n * (n + 1) + i % n).collect();
    let triangles =
        cells.iter().map(|&a| [a, a + 1, a + n + 2]).chain(cells.iter().map(|&a| [a, a + n + 2, a + n + 1]));
    TriMesh {
        positions: (0..(n + 1) * (n + 1)).map(vertex).collect(),
        triangles: triangles.collect(),
        ..TriMesh::default()
    }
}
