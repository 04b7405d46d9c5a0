//! "Tell me my cameras are wrong before showing me mush": each classic mistake, put into a good scene, is named.

use crate::command::{SIZE, inspect, reconstruct};
use crate::read_back::read_mesh;
use crate::scene_files::{height_field, read_json, write_cameras, write_scene};
use glam::{DMat3, DVec3};
use serde_json::Value;
use surfel_core::{Camera, Intrinsics, Rigid};

/// A mistake, how to make it, and the words that name cause and remedy.
type Mistake = (&'static str, fn(Camera) -> Camera, &'static [&'static str]);

fn with_pose(camera: Camera, camera_from_world: Rigid) -> Camera {
    Camera { camera_from_world, ..camera }
}

fn opengl_axes(camera: Camera) -> Camera {
    let flip = Rigid { rotation: DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)), translation: DVec3::ZERO };
    with_pose(camera, flip * camera.camera_from_world)
}

fn scaled(camera: Camera, x: f64, y: f64) -> Camera {
    let k = camera.intrinsics;
    Camera { intrinsics: Intrinsics { fx: k.fx * x, fy: k.fy * y, cx: k.cx * x, cy: k.cy * y }, ..camera }
}

const MISTAKES: [Mistake; 6] = [
    ("OpenGL axes", opengl_axes, &["OpenGL", "--axes opengl"]),
    (
        "camera-to-world for world-to-camera",
        |camera| with_pose(camera, camera.camera_from_world.inverse()),
        &["camera-to-world", "Invert"],
    ),
    (
        "OpenGL camera-to-world for world-to-camera",
        |camera| with_pose(camera, opengl_axes(camera).camera_from_world.inverse()),
        &["OpenGL", "camera-to-world", "Invert"],
    ),
    ("normalised intrinsics", |camera| scaled(camera, 1.0 / 160.0, 1.0 / 128.0), &["normalised", "Multiply"]),
    ("intrinsics of twice the resolution", |camera| scaled(camera, 2.0, 2.0), &["320 x 256", "160 x 128", "scale"]),
    ("intrinsics of other proportions", |camera| scaled(camera, 2.0, 3.0), &["another image", "scale"]),
];

#[test]
fn every_mistake_is_named_by_inspect_and_stops_reconstruct() {
    for (what, mistake, words) in MISTAKES {
        let folder = tempfile::tempdir().unwrap();
        let (scene, out) = (folder.path().join("scene"), folder.path().join("out"));
        let views = &height_field()[..2];
        write_scene(&scene, views);
        write_cameras(&scene, views, mistake);

        let picture = folder.path().join("epipolar.png");
        let verdict = inspect(&scene, &picture, &[]);
        assert_eq!(verdict.code, Some(1), "{what}: {}{}", verdict.stdout, verdict.stderr);
        assert!(image::open(&picture).is_ok(), "{what}: no picture");
        let refusal = reconstruct(&scene, &out, &["--size", SIZE]);
        assert_eq!(refusal.code, Some(1), "{what}: {}", refusal.stderr);
        assert!(!out.exists(), "{what}");
        assert!(refusal.stderr.contains("--trust-cameras"), "{what}: {}", refusal.stderr);
        for word in words {
            assert!(verdict.stdout.contains(word), "{what}: {word:?} is not in {}", verdict.stdout);
            assert!(refusal.stderr.contains(word), "{what}: {word:?} is not in {}", refusal.stderr);
        }
    }
}

#[test]
fn right_cameras_raise_no_alarm() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    write_scene(&scene, height_field());
    let run = inspect(&scene, &folder.path().join("epipolar.png"), &["--json"]).succeeded("right cameras");
    let verdict: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(verdict["status"], "Good", "{verdict}");
    assert_eq!(verdict["num_frames"], 3);
    assert_eq!(verdict["warnings"], serde_json::json!([]));
}

#[test]
fn a_person_may_insist() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, out) = (folder.path().join("scene"), folder.path().join("out"));
    let views = &height_field()[..2];
    write_scene(&scene, views);
    write_cameras(&scene, views, |camera| scaled(camera, 2.0, 2.0));
    let range = ["--near", "300", "--far", "1200"];
    let run = reconstruct(&scene, &out, &[&["--size", SIZE, "--trust-cameras"], &range[..]].concat());
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stderr.contains("warning") && run.stderr.contains("320 x 256"), "{}", run.stderr);
    let report = read_json(&out.join("report.json"));
    assert_eq!(report["camera_checks"][0]["status"], "Wrong");
}

#[test]
fn the_remedy_for_opengl_axes_works() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, out) = (folder.path().join("scene"), folder.path().join("out"));
    let views = &height_field()[..2];
    write_scene(&scene, views);
    reconstruct(&scene, &folder.path().join("right"), &["--size", SIZE]).succeeded("OpenCV axes");
    write_cameras(&scene, views, opengl_axes);
    let picture = folder.path().join("epipolar.png");
    inspect(&scene, &picture, &["--axes", "opengl"]).succeeded("inspect");
    reconstruct(&scene, &out, &["--size", SIZE, "--axes", "opengl"]).succeeded("reconstruct");
    let [right, remedied] = [folder.path().join("right"), out].map(|out| read_mesh(&out.join("mesh.ply")));
    assert_eq!(right.positions, remedied.positions);
}
