//! The whole DTU protocol against scipy on a toy scan: same points, same counts, same distances.
//!
//! `tests/fixtures/dtu_toy` and the numbers below are what `bench/peers/dtu_chamfer.py --toy 16` writes and prints.

use std::path::Path;
use surfel_core::TriMesh;
use surfel_eval::dtu::{DtuReference, DtuSettings, score_dtu};

/// The curved sheet of the script, from the same sums and products.
fn toy_mesh(n: u32) -> TriMesh {
    let side = 0.75 * f64::from(n);
    let vertex = |i: u32| {
        let (x, y) = (f64::from(i % (n + 1)) * side / f64::from(n), f64::from(i / (n + 1)) * side / f64::from(n));
        [x as f32, y as f32, (0.01 * x * x - 0.02 * x * y + 0.3 * y + 0.0) as f32]
    };
    let cells: Vec<u32> = (0..n * n).map(|i| i / n * (n + 1) + i % n).collect();
    let lower = cells.iter().map(|&a| [a, a + 1, a + n + 2]);
    let upper = cells.iter().map(|&a| [a, a + n + 2, a + n + 1]);
    TriMesh {
        positions: (0..(n + 1) * (n + 1)).map(vertex).collect(),
        triangles: lower.chain(upper).collect(),
        ..TriMesh::default()
    }
}

#[test]
fn scores_the_toy_scan_as_scipy_does() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/dtu_toy");
    let reference = DtuReference::open(&folder, 1).unwrap();
    let score = score_dtu(&toy_mesh(16), &reference, &DtuSettings::default());
    assert_eq!((score.num_data_points, score.num_surface_points), (1426, 858));
    assert!((score.d2s - 0.749_278_258_388_210_7).abs() < 1e-5, "{score:?}");
    assert!((score.s2d - 0.696_639_595_500_530_6).abs() < 1e-5, "{score:?}");
    assert!((score.overall - 0.722_958_926_944_370_6).abs() < 1e-5, "{score:?}");
}

#[test]
fn a_missing_reference_names_the_file_and_what_is_needed() {
    let error = DtuReference::open(Path::new("nowhere"), 24).unwrap_err().to_string();
    assert!(error.contains("stl024_total.ply") && error.contains("Points/stl"), "{error}");
}
