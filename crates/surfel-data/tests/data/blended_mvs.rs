//! BlendedMVS.

use crate::support::{Plane, assert_photographs, cam_text, camera, jpeg, write, write_pfm};
use std::path::Path;
use surfel_core::{Camera, Rigid};
use surfel_data::SceneViews;
use surfel_data::blended_mvs::BlendedMvsSet;

/// Units of the scene per unit of the plane.
const UNIT: f64 = 37.0;
const SIZE: (usize, usize) = (96, 72);

fn file_camera(id: usize) -> Camera {
    let camera = camera(SIZE.0, SIZE.1, id);
    let pose = camera.camera_from_world;
    Camera { camera_from_world: Rigid { translation: pose.translation * UNIT, ..pose }, ..camera }
}

fn write_scene(root: &Path, ranges: &[&str]) {
    let plane = Plane { offset: Plane::slanted().offset * UNIT, ..Plane::slanted() };
    for (id, range) in ranges.iter().enumerate() {
        let view = Plane::slanted().photograph("", camera(SIZE.0, SIZE.1, id));
        let camera = file_camera(id);
        let k = camera.intrinsics;
        // First pixel centre at 0 in the file.
        let text = cam_text(&camera.camera_from_world, [k.fx, k.fy, k.cx - 0.5, k.cy - 0.5], range);
        write(&root.join(format!("cams/{id:08}_cam.txt")), text);
        write(&root.join(format!("blended_images/{id:08}.jpg")), jpeg(&view.image));
        let depth = plane.photograph("", camera).depth.unwrap();
        write_pfm(&root.join(format!("rendered_depth_maps/{id:08}.pfm")), &depth);
    }
    write(&root.join("cams/pair.txt"), "2\n0\n1 1 5.0\n1\n1 0 5.0\n");
}

#[test]
fn every_scene_is_brought_to_one_near_depth() {
    let folder = tempfile::tempdir().unwrap();
    // The third range says nothing, as some of the set do.
    write_scene(&folder.path().join("5a1"), &["80.0 0.5 128 150.0", "75.0 0.5 128 160.0", "-3.0 0.0 128 -3.0"]);
    std::fs::create_dir_all(folder.path().join("notes")).unwrap();
    let set = BlendedMvsSet::open(folder.path()).unwrap();
    assert_eq!(set.names().collect::<Vec<_>>(), ["5a1"]);
    let mut scene = set.scene("5a1").unwrap();
    let unit_to_world = 75.0 / 2.125;
    assert!((scene.unit_to_world() - unit_to_world).abs() < 1e-12);
    let (near, far) = scene.range();
    assert!((near - 2.125).abs() < 1e-12 && (far - 160.0 / unit_to_world).abs() < 1e-12);
    assert_eq!((scene.num_views(), scene.pairs().unwrap().sources(0)), (3, [1].as_slice()));
    let scale = UNIT / unit_to_world;
    for id in 0..3 {
        let mut view = scene.view(id).unwrap();
        assert_eq!((view.image.width(), view.image.height()), SIZE);
        // Back in the unit of the plane, so that its colours can be compared.
        view.camera.camera_from_world.translation /= scale;
        view.depth = view.depth.map(|map| map.map(|z| (f64::from(*z) / scale) as f32));
        assert_eq!(assert_photographs(&view, &Plane::slanted(), 1e-5, 0.04), SIZE.0 * SIZE.1);
    }
}

#[test]
fn what_is_missing_or_damaged_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let said = |text: String, words: &[&str]| {
        words.iter().for_each(|words| assert!(text.contains(words), "{words}: {text}"));
    };
    said(BlendedMvsSet::open(folder.path()).unwrap_err().to_string(), &["holds no scene", "BlendedMVS"]);
    let root = folder.path().join("5a1");
    write_scene(&root, &["80.0 0.5 128 150.0", "80.0 0.5 128 150.0"]);
    let set = BlendedMvsSet::open(folder.path()).unwrap();
    said(set.scene("5a2").unwrap_err().to_string(), &["5a2: is no scene"]);

    let photograph = root.join("blended_images/00000001.jpg");
    let whole = std::fs::read(&photograph).unwrap();
    write(&photograph, &whole[..whole.len() / 2]);
    said(set.scene("5a1").unwrap().view(1).unwrap_err().to_string(), &["00000001.jpg", "cut short"]);
    write(&photograph, jpeg(&surfel_core::Grid::filled(768, 576, [0.5; 3])));
    said(set.scene("5a1").unwrap().view(1).unwrap_err().to_string(), &["768x576", "one resolution"]);
    write_pfm(&root.join("rendered_depth_maps/00000000.pfm"), &surfel_core::Grid::filled(96, 70, 90.0));
    said(set.scene("5a1").unwrap().view(0).unwrap_err().to_string(), &["00000000.pfm", "96x70", "another shape"]);

    write_scene(&root, &["0.0 0.0 128 0.0", "-1.0 0.5 128 9.0"]);
    said(set.scene("5a1").unwrap_err().to_string(), &["cams", "none of its 2 camera files"]);
    std::fs::remove_file(root.join("cams/pair.txt")).unwrap();
    said(set.scene("5a1").unwrap_err().to_string(), &["pair.txt"]);
}
