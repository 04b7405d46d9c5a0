//! Results as other programs would read them.

use glam::{DMat3, DMat4, DVec3};
use std::path::Path;
use surfel_core::{Camera, Grid, Intrinsics, Rigid, TriMesh};

/// A mesh file.
pub fn read_mesh(path: &Path) -> TriMesh {
    surfel_io::ply::read_ply_file(path).unwrap_or_else(|error| panic!("{error}"))
}

/// The vertices of a mesh file, scene units.
pub fn vertices(path: &Path) -> Vec<DVec3> {
    read_mesh(path).positions.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect()
}

/// Corners of the axis-aligned bounding box.
pub fn bounds(points: &[DVec3]) -> [DVec3; 2] {
    let infinite = DVec3::splat(f64::INFINITY);
    points.iter().fold([infinite, -infinite], |[low, high], p| [low.min(*p), high.max(*p)])
}

/// Header lines of a PLY file.
pub fn ply_header(path: &Path) -> Vec<String> {
    let bytes = std::fs::read(path).unwrap();
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(4096)]);
    let (header, _) = text.split_once("end_header").expect("a PLY header");
    assert!(header.starts_with("ply\n"));
    header.lines().map(str::to_owned).collect()
}

/// Every file below a folder, relative to it, with `/`, sorted.
pub fn files_below(folder: &Path) -> Vec<String> {
    fn collect(folder: &Path, prefix: &str, found: &mut Vec<String>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let entry = entry.unwrap();
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            if entry.file_type().unwrap().is_dir() {
                collect(&entry.path(), &format!("{name}/"), found);
            } else {
                found.push(name);
            }
        }
    }
    let mut found = Vec::new();
    collect(folder, "", &mut found);
    found.sort();
    found
}

/// Share of the pixels with a true depth whose depth is within `tolerance` (relative) of it; a missing one is not.
pub fn share_within(depth: &Grid<f32>, truth: &Grid<f32>, tolerance: f32) -> f64 {
    assert!(depth.same_size(truth));
    let pairs: Vec<(f32, f32)> = depth.as_slice().iter().copied().zip(truth.as_slice().iter().copied()).collect();
    let known = pairs.iter().filter(|(_, truth)| *truth > 0.0);
    let right = known.clone().filter(|(z, truth)| (z - truth).abs() <= tolerance * truth);
    right.count() as f64 / known.count() as f64
}

/// The cameras of an output's `cameras.json`.
pub fn read_cameras(path: &Path) -> Vec<Camera> {
    let numbers = |value: &serde_json::Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    };
    let camera = |entry: &serde_json::Value| {
        let (k, pose) = (numbers(&entry["K"]), numbers(&entry["camera_from_world"]));
        let pose = DMat4::from_cols_slice(&pose).transpose();
        Camera {
            intrinsics: Intrinsics { fx: k[0], fy: k[4], cx: k[2], cy: k[5] },
            width: entry["width"].as_u64().unwrap() as usize,
            height: entry["height"].as_u64().unwrap() as usize,
            camera_from_world: Rigid { rotation: DMat3::from_mat4(pose), translation: pose.w_axis.truncate() },
        }
    };
    crate::scene_files::read_json(path).as_array().unwrap().iter().map(camera).collect()
}
