//! What must not change the mesh: the unit of the scene and the number of threads.

mod scene;

use scene::*;
use surfel_core::TriMesh;
use surfel_mesh::{MaskConfig, MeshConfig, MeshReport, mesh_from_views};

fn mesh_at(scale: f64) -> (TriMesh, MeshReport) {
    let shots: Vec<Shot> = sphere_and_wall().iter().map(|shot| shot.scaled(scale)).collect();
    mesh_from_views(&views(&shots), &MeshConfig::default()).unwrap()
}

#[test]
fn a_scene_scaled_by_a_power_of_two_gives_the_same_mesh_to_the_last_bit() {
    let ((small, small_report), (large, large_report)) = (mesh_at(1.0), mesh_at(1024.0));
    assert!(small.triangles.len() > 10_000);
    assert_eq!(large.triangles, small.triangles);
    assert_eq!(large.normals, small.normals);
    assert_eq!(large.colours, small.colours);
    let rescaled: Vec<_> = small.positions.iter().map(|p| p.map(|c| c * 1024.0)).collect();
    assert_eq!(large.positions, rescaled);
    assert_eq!(large_report.tsdf.voxel, small_report.tsdf.voxel * 1024.0);
    assert_eq!(large_report.components, small_report.components);
}

#[test]
fn a_scene_scaled_by_1000_gives_a_mesh_scaled_by_1000() {
    // A factor that is no power of two rounds the depths themselves, in the 8th digit: a field value of 1e-4
    // voxel may change sign and add or drop a sliver, never more.
    let ((small, small_report), (large, _)) = (mesh_at(1.0), mesh_at(1000.0));
    let counts = (small.triangles.len() as f64, large.triangles.len() as f64);
    assert!((counts.0 - counts.1).abs() < 0.002 * counts.0, "{counts:?} triangles");
    let voxel = small_report.tsdf.voxel as f32;
    let cell = |p: [f32; 3]| p.map(|c| (c / voxel).floor() as i32);
    let mut by_cell = std::collections::HashMap::<_, Vec<[f32; 3]>>::new();
    for p in &small.positions {
        by_cell.entry(cell(*p)).or_default().push(*p);
    }
    for p in large.positions.iter().map(|p| p.map(|c| c / 1000.0)) {
        let [x, y, z] = cell(p);
        let around = (-1..=1).flat_map(|i| (-1..=1).flat_map(move |j| (-1..=1).map(move |k| [x + i, y + j, z + k])));
        let nearest = around
            .filter_map(|cell| by_cell.get(&cell))
            .flatten()
            .map(|q| (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f32>().sqrt())
            .fold(f32::INFINITY, f32::min);
        assert!(nearest < 0.01 * voxel, "{p:?} has no counterpart within {nearest}");
    }
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| mesh_at(1.0))
    };
    let (one, five) = (run(1), run(5));
    assert_eq!(one, five);
}

#[test]
fn masks_count_every_pixel_once() {
    let shots = sphere_and_wall();
    let mask = MaskConfig { max_angle_deg: 60.0, border: 4, ..MaskConfig::default() };
    let config = MeshConfig { mask, ..MeshConfig::default() };
    let (_, report) = mesh_from_views(&views(&shots), &config).unwrap();
    for (counts, shot) in report.masks.iter().zip(&shots) {
        let total = counts.without_depth + counts.border + counts.depth_edge + counts.grazing + counts.kept;
        assert_eq!(total, shot.depth.len());
        assert_eq!(counts.border, 2 * 4 * (96 + 72 - 8) - counts.without_depth);
        assert!(counts.depth_edge > 50 && counts.grazing > 10 && counts.kept > 3_000, "{counts:?}");
    }
}
