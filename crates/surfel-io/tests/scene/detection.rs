//! Which cameras are taken when a folder leaves a choice, and how photographs are picked by name.

use crate::written::{self, golden, write_images};
use std::path::Path;
use surfel_io::{FormatKind, Scene, SceneError};

fn scene_in(folder: &Path, writers: &[fn(&Path, &[surfel_core::Camera])]) {
    let cameras = golden(false);
    write_images(folder, cameras.len());
    writers.iter().for_each(|write| write(folder, &cameras));
}

#[test]
fn of_several_formats_the_preferred_is_taken_and_the_others_are_named() {
    let folder = tempfile::tempdir().unwrap();
    scene_in(folder.path(), &[written::transforms, written::colmap_text, written::cameras_json]);
    let scene = Scene::open(folder.path()).unwrap();
    assert_eq!(scene.format.to_string(), "COLMAP text (sparse/0), 4 images, 1 camera");
    let warning = scene.warnings.join("\n");
    assert!(warning.contains("transforms.json") && warning.contains("cameras.json"), "{warning}");
    let asked = Scene::open_as(folder.path(), FormatKind::CamerasJson).unwrap();
    assert_eq!(asked.format.kind, FormatKind::CamerasJson);
    let absent = Scene::open_as(folder.path(), FormatKind::Llff).unwrap_err().to_string();
    assert!(absent.contains("poses_bounds.npy"), "{absent}");
}

#[test]
fn of_two_colmap_models_the_larger_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = golden(false);
    write_images(folder.path(), cameras.len());
    written::colmap_text(folder.path(), &cameras[..2]);
    std::fs::rename(folder.path().join("sparse/0"), folder.path().join("sparse/1")).unwrap();
    written::colmap_text(folder.path(), &cameras);
    std::fs::rename(folder.path().join("sparse/0"), folder.path().join("sparse/2")).unwrap();
    let scene = Scene::open(folder.path()).unwrap();
    assert_eq!((scene.format.source.as_path(), scene.frames.len()), (Path::new("sparse/2"), 4));
    assert!(scene.warnings[0].contains("sparse/1"), "{:?}", scene.warnings);
}

#[test]
fn the_camera_file_or_its_folder_means_the_scene() {
    let cases: [(fn(&Path, &[surfel_core::Camera]), &[&str]); 4] = [
        (written::colmap_text, &["sparse/0/images.txt", "sparse/0", "sparse"]),
        (written::transforms, &["transforms.json"]),
        (written::mvsnet, &["cams", "cams/00000002_cam.txt"]),
        (written::strecha, &["cameras", "cameras/000001.png.camera"]),
    ];
    for (writer, paths) in cases {
        let folder = tempfile::tempdir().unwrap();
        scene_in(folder.path(), &[writer]);
        for path in paths {
            let scene = Scene::open(&folder.path().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
            assert_eq!(scene.frames.len(), 4, "{path}");
        }
    }
}

#[test]
fn a_folder_of_scenes_is_an_error_that_lists_them_and_one_scene_inside_is_opened() {
    let folder = tempfile::tempdir().unwrap();
    scene_in(&folder.path().join("left"), &[written::transforms]);
    let scene = Scene::open(folder.path()).unwrap();
    assert!(scene.warnings[0].contains("left"), "{:?}", scene.warnings);
    scene_in(&folder.path().join("right"), &[written::transforms]);
    let error = Scene::open(folder.path()).unwrap_err();
    assert!(matches!(error, SceneError::SeveralScenes { .. }));
    let message = error.to_string();
    assert!(message.contains("left") && message.contains("right") && message.contains("pass one"), "{message}");
}

#[test]
fn a_folder_without_cameras_is_told_what_was_looked_for() {
    let folder = tempfile::tempdir().unwrap();
    write_images(folder.path(), 3);
    let message = Scene::open(folder.path()).unwrap_err().to_string();
    for expected in ["sparse/0", "transforms.json", "cameras.npz", "trajectory.log", "COLMAP"] {
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn photographs_are_picked_by_name_stem_or_number() {
    let folder = tempfile::tempdir().unwrap();
    scene_in(folder.path(), &[written::transforms]);
    let scene = Scene::open(folder.path()).unwrap();
    let select = |names: &[&str]| scene.select(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
    assert_eq!(select(&["images/000002.png", "000001.png", "000003", "0"]).unwrap(), [2, 1, 3, 0]);
    let message = select(&["7"]).unwrap_err().to_string();
    assert!(message.contains("\"7\"") && message.contains("000001.png"), "{message}");
    let mut twins = scene.clone();
    twins.frames[3].image_path = folder.path().join("images/000002.jpg");
    let names = ["2".to_owned()];
    let message = twins.select(&names).unwrap_err().to_string();
    assert!(message.contains("000002.png") && message.contains("000003.png"), "{message}");
}

#[test]
fn numbering_decides_over_rank_when_views_are_missing() {
    let folder = tempfile::tempdir().unwrap();
    scene_in(folder.path(), &[written::idr]);
    std::fs::remove_file(folder.path().join("images/000001.png")).unwrap();
    let scene = Scene::open(folder.path()).unwrap();
    let expected = golden(false);
    assert_eq!(scene.frames.len(), 3);
    for (frame, index) in scene.frames.iter().zip([0, 2, 3]) {
        assert_eq!(frame.stem(), format!("{index:06}"));
        let (a, b) = (frame.camera_from_world.to_mat4(), expected[index].camera_from_world.to_mat4());
        assert!(a.abs_diff_eq(b, 1e-6));
    }
    assert!(scene.warnings.iter().any(|warning| warning.contains("1 of 4")), "{:?}", scene.warnings);
}

#[test]
fn images_numbered_from_one_go_with_cameras_numbered_from_zero() {
    let folder = tempfile::tempdir().unwrap();
    scene_in(folder.path(), &[written::idr]);
    for index in (0..4).rev() {
        let name = |number: usize| folder.path().join(format!("images/{number:06}.png"));
        std::fs::rename(name(index), name(index + 1)).unwrap();
    }
    let scene = Scene::open(folder.path()).unwrap();
    assert_eq!(
        scene.frames.iter().map(|frame| frame.stem()).collect::<Vec<_>>(),
        ["000001", "000002", "000003", "000004"]
    );
}
