//! Real photographs: every development scene becomes a mesh without flags, and its cameras raise no alarm.
//!
//! Needs the shared data (`SURFELSPLAT_SHARED`, or `../shared` beside the workspace); skipped aloud without.

use crate::command::{inspect, reconstruct};
use crate::read_back::read_mesh;
use std::path::PathBuf;

/// Scene and a small working size of its shape.
const SCENES: [(&str, &str); 8] = [
    ("dtu_scan24", "160x120"),
    ("hololens_000", "160x120"),
    ("middlebury_temple_sparse_ring", "160x120"),
    ("ngp_fox", "120x208"),
    ("redwood_rgbd5", "160x120"),
    ("robustmvd_table", "160x120"),
    ("sceaux_castle", "160x106"),
    ("strecha_fountain_p11", "160x106"),
];

fn shared_scene(name: &str) -> Option<PathBuf> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let shared = std::env::var_os("SURFELSPLAT_SHARED").map_or(beside, PathBuf::from);
    let path = shared.join("data/scenes").join(name);
    if !path.is_dir() {
        eprintln!("SKIPPED: {} is not there", path.display());
        return None;
    }
    Some(path)
}

#[test]
fn every_development_scene_becomes_a_mesh_without_flags() {
    for (name, size) in SCENES {
        let Some(scene) = shared_scene(name) else { continue };
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let run = reconstruct(&scene, &out, &["--size", size]).succeeded(name);
        let mesh = read_mesh(&out.join("mesh.ply"));
        println!("{name}: {} triangles\n{}{}", mesh.triangles.len(), run.stderr, run.stdout);
        assert!(mesh.triangles.len() > 1000, "{name}: {} triangles\n{}", mesh.triangles.len(), run.stderr);
        assert!(mesh.positions.iter().flatten().all(|v| v.is_finite()), "{name}");
    }
}

#[test]
fn no_development_scene_raises_a_false_alarm() {
    for (name, _) in SCENES {
        let Some(scene) = shared_scene(name) else { continue };
        let folder = tempfile::tempdir().unwrap();
        let run = inspect(&scene, &folder.path().join("epipolar.png"), &[]);
        println!("{name}: {}", run.stdout);
        assert_eq!(run.code, Some(0), "{name}: {}{}", run.stdout, run.stderr);
    }
}
