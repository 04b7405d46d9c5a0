//! Real reference depth and points agree with each other through the scene's cameras.

use std::path::PathBuf;
use surfel_core::{Camera, Intrinsics, Rigid};
use surfel_eval::Reference;
use surfel_eval::object_chamfer::{back_projected, object_chamfer, seen_points};
use surfel_io::npy::Npz;

fn shared() -> PathBuf {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    std::env::var_os("SURFELSPLAT_SHARED").map_or(beside, PathBuf::from)
}

/// Camera of view 23 of the scan, decomposed once with `bench/peers/export_cameras.py`.
fn camera_of(scene: &std::path::Path) -> Camera {
    let mut npz = Npz::open(&scene.join("cameras_sphere.npz")).unwrap();
    let p = npz.array("world_mat_23").unwrap().data;
    let row = |i: usize| glam::DVec3::new(p[4 * i], p[4 * i + 1], p[4 * i + 2]);
    // RQ by Gram-Schmidt from the last row up: K is upper triangular with positive diagonal.
    let scale = row(2).length();
    let (m, t) = ([row(0), row(1), row(2)].map(|r| r / scale), [p[3], p[7], p[11]].map(|v| v / scale));
    let r3 = m[2];
    let (cy, cx) = (m[1].dot(r3), m[0].dot(r3));
    let fy = (m[1] - r3 * cy).length();
    let r2 = (m[1] - r3 * cy) / fy;
    let skew = m[0].dot(r2);
    let fx = (m[0] - r3 * cx - r2 * skew).length();
    let r1 = (m[0] - r3 * cx - r2 * skew) / fx;
    let ty = (t[1] - cy * t[2]) / fy;
    let tx = (t[0] - cx * t[2] - skew * ty) / fx;
    let rotation = glam::DMat3::from_cols(r1, r2, r3).transpose();
    let pose = Rigid::from_matrix(rotation, glam::DVec3::new(tx, ty, t[2])).unwrap();
    let intrinsics = Intrinsics::from_index_coordinates(fx, fy, cx, cy);
    Camera { intrinsics, width: 1600, height: 1200, camera_from_world: pose }
}

#[test]
fn depth_maps_and_points_of_a_scan_describe_one_surface() {
    let scene = shared().join("data/scenes/dtu_scan24");
    if !scene.is_dir() {
        eprintln!("SKIPPED: {} is missing", scene.display());
        return;
    }
    let camera = camera_of(&scene);
    let reference = Reference::open(&scene).unwrap().unwrap();
    let (depth, intrinsics) = reference.depth_of("000023", &camera).unwrap().unwrap();
    let raster = Camera { intrinsics, ..camera.resized(depth.width(), depth.height()) };
    let cloud = reference.points().unwrap().unwrap();
    assert_eq!(cloud.positions.len(), cloud.normals.len());
    let seen = seen_points(&cloud.positions, &[(&depth, raster)], 0.01);
    assert!(seen.len() > cloud.positions.len() / 5, "{} of {} points seen", seen.len(), cloud.positions.len());
    // Points are voxel averages 0.6 mm apart; the depth maps were culled by nothing, hence the looser accuracy.
    let score = object_chamfer(&back_projected(&depth, &raster), &seen, 20.0);
    assert!(score.completeness < 0.5, "{score:?}");
}
