//! The development scenes open without flags, and their cameras agree with their photographs.
//!
//! Needs the shared data (`SURFELSPLAT_SHARED`, or `../shared` beside the workspace); skipped aloud without.

use std::path::PathBuf;
use surfel_io::{FormatKind, Scene};

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

/// Folder, format, photographs, focal length of the first at its image's size, number of masks.
const SCENES: [(&str, FormatKind, usize, f64, usize); 8] = [
    ("dtu_scan24", FormatKind::Idr, 30, 2892.33, 30),
    ("hololens_000", FormatKind::PosesText, 29, 495.568, 0),
    ("middlebury_temple_sparse_ring", FormatKind::Middlebury, 16, 1520.4, 0),
    ("ngp_fox", FormatKind::Transforms, 26, 687.76, 0),
    ("redwood_rgbd5", FormatKind::TrajectoryLog, 5, 525.0, 0),
    ("robustmvd_table", FormatKind::RobustMvd, 7, 924.875, 0),
    ("sceaux_castle", FormatKind::CamerasJson, 10, 1492.664, 0),
    ("strecha_fountain_p11", FormatKind::Strecha, 11, 1379.74, 0),
];

#[test]
fn every_development_scene_opens_without_flags() {
    for (name, kind, num_images, focal, num_masks) in SCENES {
        let Some(path) = shared_scene(name) else { continue };
        let scene = Scene::open(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
        println!("{name}: {}\n  {:?}", scene.format, scene.warnings);
        assert_eq!((scene.format.kind, scene.frames.len()), (kind, num_images), "{name}");
        assert!((scene.frames[0].intrinsics.fx - focal).abs() < 0.01, "{name}: {:?}", scene.frames[0].intrinsics);
        assert_eq!(scene.frames.iter().filter(|frame| frame.mask_path.is_some()).count(), num_masks, "{name}");
        let view = scene.frames[1].load(160, 120).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(view.valid.as_slice().iter().filter(|valid| **valid).count() > 2000, "{name}");
    }
}
