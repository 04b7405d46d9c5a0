//! The DTU protocol against its scipy twin (`bench/peers/dtu_chamfer.py`) on one scan, measured in the same run.
//!
//! `cargo bench -p surfel-eval --bench dtu_chamfer`; SURFELSPLAT_PYTHON names a Python with numpy and scipy.

use std::path::Path;
use std::process::Command;
use std::time::Instant;
use surfel_core::TriMesh;
use surfel_eval::dtu::{DtuReference, DtuSettings, score_dtu};

const CELLS: u32 = 200;

fn main() {
    let folder = std::env::temp_dir().join("surfel_eval_bench_dtu");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bench/peers/dtu_chamfer.py");
    let python = std::env::var("SURFELSPLAT_PYTHON").unwrap_or_else(|_| "python3".into());
    let output = Command::new(&python).arg(script).args(["--toy", &CELLS.to_string()]).arg(&folder).output();
    let peer: serde_json::Value = match output {
        Ok(output) if output.status.success() => serde_json::from_slice(&output.stdout).expect("the peer prints JSON"),
        _ => return eprintln!("SKIPPED: `{python}` cannot run the scipy peer; set SURFELSPLAT_PYTHON"),
    };
    let reference = DtuReference::open(&folder, 1).expect("the peer wrote the scan");
    let mesh = toy_mesh(CELLS);
    let start = Instant::now();
    let score = score_dtu(&mesh, &reference, &DtuSettings::default());
    let ours = start.elapsed().as_secs_f64();
    let theirs = peer["seconds"].as_f64().expect("seconds");
    println!("{} points: ours {ours:.2} s, scipy {theirs:.2} s, ratio {:.1}", score.num_data_points, theirs / ours);
    println!("overall: ours {:.6} mm, scipy {:.6} mm", score.overall, peer["overall"].as_f64().expect("overall"));
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
