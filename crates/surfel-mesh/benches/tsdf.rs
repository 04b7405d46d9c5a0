//! Milliseconds to fuse and extract two depth maps of a bumpy surface at 650 mm with 1 mm voxels.
//!
//! `cargo bench -p surfel-mesh --bench tsdf -- --dump DIR` also writes the maps, the cameras and our times to
//! `DIR/<size>/`, for `bench/peers/open3d_tsdf.py`, which measures Open3D on them and prints the ratio.

use glam::DVec3;
use std::{
    path::{Path, PathBuf},
    time::Instant,
};
use surfel_core::{Camera, Grid, Intrinsics, Rigid};
use surfel_mesh::{DepthView, TsdfConfig, fuse};

const VOXEL: f64 = 1.0;
const RUNS: usize = 9;

struct Shot {
    camera: Camera,
    depth: Grid<f32>,
    colour: Grid<[f32; 3]>,
}

fn main() -> std::io::Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let dump = arguments.iter().position(|a| a == "--dump").and_then(|at| arguments.get(at + 1)).map(PathBuf::from);
    for (width, height) in [(320, 256), (640, 512)] {
        let shots = [-50.0, 50.0].map(|x| take(x, width, height));
        let views: Vec<DepthView<'_>> = shots
            .iter()
            .map(|shot| DepthView { camera: &shot.camera, depth: &shot.depth, colour: &shot.colour, weight: None })
            .collect();
        let config = TsdfConfig::uniform(VOXEL);
        let (mut fuse_ms, mut extract_ms) = (Vec::new(), Vec::new());
        let mut last = None;
        for _ in 0..RUNS {
            let start = Instant::now();
            let tsdf = fuse(&views, &config).expect("the maps are good");
            fuse_ms.push(start.elapsed().as_secs_f64() * 1e3);
            let start = Instant::now();
            let mesh = tsdf.extract();
            extract_ms.push(start.elapsed().as_secs_f64() * 1e3);
            last = Some((tsdf.num_blocks(), tsdf.num_bytes(), mesh));
        }
        let (num_blocks, num_bytes, mesh) = last.expect("at least one run");
        let error: f64 = mesh.positions.iter().map(|p| (f64::from(p[2]) - surface(p[0], p[1])).abs()).sum();
        let (fuse_ms, extract_ms) = (median(fuse_ms), median(extract_ms));
        println!(
            "2 views {width}x{height}: fuse {fuse_ms:.1} ms + extract {extract_ms:.1} ms = {:.1} ms; {} triangles, \
             {num_blocks} blocks, {:.1} MB, mean error along z {:.4} voxel, {} threads",
            fuse_ms + extract_ms,
            mesh.triangles.len(),
            num_bytes as f64 / 1e6,
            error / mesh.positions.len() as f64 / VOXEL,
            rayon::current_num_threads(),
        );
        if let Some(folder) = &dump {
            write_maps(&folder.join(format!("{width}x{height}")), &shots, fuse_ms, extract_ms)?;
        }
    }
    Ok(())
}

/// Height of the bumpy surface, mm along z.
fn surface(x: f32, y: f32) -> f64 {
    let (x, y) = (f64::from(x), f64::from(y));
    650.0 + 30.0 * (x / 25.0).sin() * (y / 30.0).cos() + 2.0 * (x / 6.0).sin() * (y / 5.0).sin()
}

/// A camera looking along +z from `(x, 0, 0)` with the angle of view of DTU.
fn take(x: f64, width: usize, height: usize) -> Shot {
    let focal = 1.8 * width as f64;
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: width as f64 / 2.0, cy: height as f64 / 2.0 };
    let camera_from_world = Rigid { translation: DVec3::new(-x, 0.0, 0.0), ..Rigid::IDENTITY };
    let camera = Camera { intrinsics, width, height, camera_from_world };
    let depth = Grid::from_fn(width, height, |px, py| {
        let ray = camera.ray(Camera::pixel_centre(px, py));
        // The surface is flatter than the rays are steep, so this converges.
        (0..100).fold(650.0, |z, _| surface((x + ray.x * z) as f32, (ray.y * z) as f32)) as f32
    });
    let colour = Grid::from_fn(width, height, |px, py| [px as f32 / width as f32, py as f32 / height as f32, 0.5]);
    Shot { camera, depth, colour }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn write_maps(folder: &Path, shots: &[Shot], fuse_ms: f64, extract_ms: f64) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let mut views = Vec::new();
    for (index, shot) in shots.iter().enumerate() {
        write_pfm(&folder.join(format!("{index}_depth.pfm")), "Pf", &shot.depth, |z, out| {
            out.extend(z.to_le_bytes());
        })?;
        write_pfm(&folder.join(format!("{index}_colour.pfm")), "PF", &shot.colour, |colour, out| {
            out.extend(colour.iter().flat_map(|c| c.to_le_bytes()));
        })?;
        let (k, centre) = (&shot.camera.intrinsics, shot.camera.intrinsics.principal_index());
        let t = shot.camera.camera_from_world.translation;
        views.push(format!(
            r#"{{"depth": "{index}_depth.pfm", "colour": "{index}_colour.pfm", "fx": {}, "fy": {}, "cx_index": {}, "cy_index": {}, "camera_from_world": [[1, 0, 0, {}], [0, 1, 0, {}], [0, 0, 1, {}], [0, 0, 0, 1]]}}"#,
            k.fx, k.fy, centre.x, centre.y, t.x, t.y, t.z
        ));
    }
    let truncation = TsdfConfig::uniform(VOXEL).truncation;
    let text = format!(
        r#"{{"voxel": {VOXEL}, "truncation": {truncation}, "ours_fuse_ms": {fuse_ms}, "ours_extract_ms": {extract_ms}, "views": [{}]}}"#,
        views.join(", ")
    );
    std::fs::write(folder.join("cameras.json"), text)
}

fn write_pfm<T>(path: &Path, kind: &str, grid: &Grid<T>, pixel: impl Fn(&T, &mut Vec<u8>)) -> std::io::Result<()> {
    let mut bytes = format!("{kind}\n{} {}\n-1.0\n", grid.width(), grid.height()).into_bytes();
    for y in (0..grid.height()).rev() {
        for value in grid.row(y) {
            pixel(value, &mut bytes);
        }
    }
    std::fs::write(path, bytes)
}
