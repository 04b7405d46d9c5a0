//! DTU as MVSNet trains on it.

use crate::support::{Plane, assert_photographs, cam_text, camera, png, write, write_pfm};
use std::fmt::Write as _;
use std::path::Path;
use surfel_core::{Camera, Grid, Intrinsics, Rigid};
use surfel_data::choice::{Choice, PairChooser};
use surfel_data::dtu::{DtuSet, UNIT_TO_WORLD};
use surfel_data::{SceneViews, load};
use surfel_synth::Random;

/// As the training cameras of the set, for 160 x 128.
const K: [f64; 4] = [361.54, 360.40, 82.90, 66.38];
const NUM_VIEWS: usize = 11;

/// In millimetres.
fn pose(id: usize) -> Rigid {
    let pose = camera(160, 128, id).camera_from_world;
    Rigid { translation: pose.translation * UNIT_TO_WORLD, ..pose }
}

/// The same plane, in millimetres.
fn plane() -> Plane {
    Plane { offset: Plane::slanted().offset * UNIT_TO_WORLD, ..Plane::slanted() }
}

/// How the set was made: full-size coordinates in halves, a crop, every fourth pixel. In millimetres.
fn full_camera(id: usize) -> Camera {
    let [fx, fy, cx, cy] = K;
    let intrinsics =
        Intrinsics::from_index_coordinates(8.0 * fx, 8.0 * fy, 2.0 * (4.0 * cx + 80.0), 2.0 * (4.0 * cy + 44.0));
    Camera { intrinsics, width: 1600, height: 1200, camera_from_world: pose(id) }
}

/// A photograph whose pixels cover `factor` full pixels each.
fn photograph(id: usize, factor: usize) -> Grid<[f32; 3]> {
    let camera = full_camera(id);
    let f = factor as f64;
    Grid::from_fn(1280 / factor, 1024 / factor, |x, y| {
        let pixel = Camera::pixel_centre(x, y) * f + glam::DVec2::new(160.0, 88.0);
        Plane::colour(camera.unproject(pixel, plane().depth(&camera, pixel)) / UNIT_TO_WORLD)
    })
}

fn write_set(root: &Path, factor: usize, ids: &[usize]) {
    let mut pairs = format!("{NUM_VIEWS}\n");
    for id in 0..NUM_VIEWS {
        let text = cam_text(&pose(id), K, "425.0 2.5");
        write(&root.join(format!("Cameras/train/{id:08}_cam.txt")), text);
        let others = (1..NUM_VIEWS).map(|k| format!("{} {}", (id + k) % NUM_VIEWS, 100 - k));
        writeln!(pairs, "{id}\n{} {}", NUM_VIEWS - 1, others.collect::<Vec<_>>().join(" ")).unwrap();
    }
    write(&root.join("Cameras/pair.txt"), pairs);
    for &id in ids {
        let image = photograph(id, factor);
        write(&root.join(format!("Rectified/scan4_train/rect_{:03}_3_r5000.png", id + 1)), png(&image));
        let camera = full_camera(id);
        let depth = Grid::from_fn(160, 128, |x, y| {
            let pixel = Camera::pixel_centre(8 * x + 160, 8 * y + 88);
            if y < 4 { 0.0 } else { plane().depth(&camera, pixel) as f32 }
        });
        write_pfm(&root.join(format!("Depths/scan4_train/depth_map_{id:04}.pfm")), &depth);
        let mask = Grid::from_fn(160, 128, |x, _| if x < 40 { [0.0; 3] } else { [1.0; 3] });
        write(&root.join(format!("Depths/scan4_train/depth_visual_{id:04}.png")), png(&mask));
    }
}

#[test]
fn photographs_cameras_and_depth_agree_to_a_fraction_of_a_pixel() {
    let folder = tempfile::tempdir().unwrap();
    write_set(folder.path(), 2, &[0, 7]);
    let set = DtuSet::open(folder.path(), 3).unwrap();
    assert_eq!(set.scans().unwrap(), [4]);
    let mut scan = set.scan(4).unwrap();
    assert_eq!((scan.num_views(), scan.range(), scan.unit_to_world()), (NUM_VIEWS, (2.125, 4.525), 200.0));
    for id in [0, 7] {
        let view = scan.view(id).unwrap();
        assert_eq!((view.image.width(), view.image.height()), (640, 512));
        // 0.0001 units are 0.02 mm; a pixel of the photograph is 0.4 mm.
        let known = assert_photographs(&view, &Plane::slanted(), 1e-4, 0.01);
        assert!(known > 630 * 490, "{known}");
        let depth = view.depth.as_ref().unwrap();
        assert_eq!((depth[(300, 5)], depth[(639, 300)]), (0.0, 0.0));
        let mask = view.mask.as_ref().unwrap();
        assert_eq!((mask[(159, 9)], mask[(160, 9)]), (false, true));
        // Not twice the principal point: the focal length in image widths is that of the file.
        assert!((view.camera.intrinsics.fx / 640.0 - K[0] / 160.0).abs() < 1e-9);
        assert!((view.camera.intrinsics.cx - (4.0 * K[2] + 0.25)).abs() < 1e-9);
    }
}

#[test]
fn a_sample_of_the_set_is_in_one_unit_and_size() {
    let folder = tempfile::tempdir().unwrap();
    write_set(folder.path(), 8, &(0..NUM_VIEWS).collect::<Vec<_>>());
    let set = DtuSet::open(folder.path(), 3).unwrap();
    let mut scan = set.scan(4).unwrap();
    let pairs = scan.pairs().unwrap();
    assert_eq!(pairs.sources(3)[..2], [4, 5]);
    let choice = PairChooser::dtu().choose(pairs, scan.num_views(), &mut Random::new(3)).unwrap();
    let scene = load(&mut scan, &choice, 80, 60).unwrap();
    assert_eq!((scene.contexts.len(), scene.targets.len(), scene.unit_to_world), (2, 4, 200.0));
    for view in scene.contexts.iter().chain(&scene.targets) {
        assert_eq!((view.image.width(), view.image.height()), (80, 60));
        // The nearest depth lies half a photograph's pixel away at most, 0.01 units on this plane.
        assert_photographs(view, &Plane::slanted(), 5e-3, 0.02);
    }
}

#[test]
fn what_is_missing_or_damaged_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let fault = |text: String, words: &[&str]| {
        words.iter().for_each(|words| assert!(text.contains(words), "{words}: {text}"));
    };
    fault(DtuSet::open(root, 3).unwrap_err().to_string(), &["pair.txt"]);
    write(&root.join("Cameras/pair.txt"), "0");
    fault(DtuSet::open(root, 3).unwrap_err().to_string(), &["Cameras/train/00000000_cam.txt"]);
    write(&root.join("Cameras/train/00000000_cam.txt"), "extrinsic 1 2 3 intrinsic");
    fault(DtuSet::open(root, 3).unwrap_err().to_string(), &["00000000_cam.txt", "needs"]);
    write_set(root, 8, &[0]);
    let set = DtuSet::open(root, 3).unwrap();
    fault(set.scan(5).unwrap_err().to_string(), &["scan5"]);
    fault(set.scan(4).unwrap().view(1).unwrap_err().to_string(), &["rect_002_3_r5000.png"]);
    fault(DtuSet::open(root, 6).unwrap().scan(4).unwrap().view(0).unwrap_err().to_string(), &["rect_001_6_r5000.png"]);

    let depth = root.join("Depths/scan4_train/depth_map_0000.pfm");
    write_pfm(&depth, &Grid::filled(160, 120, 500.0));
    fault(set.scan(4).unwrap().view(0).unwrap_err().to_string(), &["depth_map_0000.pfm: has 160x120", "160x128"]);
    write(&depth, "Pf\n160 128\n-1.0\nshort");
    fault(set.scan(4).unwrap().view(0).unwrap_err().to_string(), &["depth_map_0000.pfm", "cut short"]);
    // Without depth and mask a scan is still a set of photographs.
    std::fs::remove_dir_all(root.join("Depths")).unwrap();
    let view = set.scan(4).unwrap().view(0).unwrap();
    assert!(view.depth.is_none() && view.mask.is_none());
    let odd = png(&Grid::filled(30, 30, [0.5; 3]));
    write(&root.join("Rectified/scan4_train/rect_001_3_r5000.png"), odd);
    fault(set.scan(4).unwrap().view(0).unwrap_err().to_string(), &["rect_001_3_r5000.png", "30x30"]);
    let choice = Choice { contexts: vec![0], targets: vec![] };
    assert!(load(&mut set.scan(4).unwrap(), &choice, 16, 16).is_err());
}
