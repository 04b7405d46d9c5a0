//! Poses of trackers: cameras that stand where they are said to stand and look two pixels past are mended, aloud.

use crate::command::{SIZE, reconstruct};
use crate::read_back::{read_cameras, share_within};
use crate::scene_files::{height_field, read_json, write_cameras, write_scene};
use glam::DMat3;
use std::path::Path;
use surfel_core::Camera;
use surfel_io::depth::read_pfm;

/// Turns `camera` about the line to `first`, so that what it sees moves across its epipolar lines, by 2 pixels.
fn misled(camera: Camera, first: &Camera) -> Camera {
    let Some(line) = (camera.centre() - first.centre()).try_normalize() else { return camera };
    camera.turned(DMat3::from_axis_angle(line, -2.0 / camera.intrinsics.mean_focal()))
}

/// Share of the pixels of both views within 1 % of the exact depth.
fn share(out: &Path) -> f64 {
    let of = |index: usize| {
        let depth = read_pfm(&out.join(format!("depth/{index:02}.pfm"))).unwrap();
        share_within(&depth, &height_field()[index].depth, 0.01)
    };
    0.5 * (of(0) + of(1))
}

#[test]
fn cameras_that_look_past_are_turned_where_they_stand() {
    let folder = tempfile::tempdir().unwrap();
    let [scene, right, mended, trusted] = ["scene", "right", "mended", "trusted"].map(|name| folder.path().join(name));
    let views = &height_field()[..2];
    write_scene(&scene, views);
    let quiet = reconstruct(&scene, &right, &["--size", SIZE]).succeeded("right cameras");
    assert!(!quiet.stderr.contains("--trust-cameras"), "{}", quiet.stderr);
    assert!(read_json(&right.join("report.json"))["camera_turn"].is_null());

    write_cameras(&scene, views, |camera| misled(camera, &views[0].view.camera));
    let aloud = reconstruct(&scene, &mended, &["--size", SIZE]).succeeded("misled cameras");
    assert!(aloud.stderr.contains("warning") && aloud.stderr.contains("--trust-cameras"), "{}", aloud.stderr);
    let turn = &read_json(&mended.join("report.json"))["camera_turn"];
    let px = |key: &str| turn[key].as_f64().unwrap();
    assert!((px("median_epipolar_px_before") - 2.0).abs() < 0.3, "{turn}");
    assert!(px("median_epipolar_px_after") < 0.3, "{turn}");
    let used = read_cameras(&mended.join("cameras.json"));
    for (used, rendered) in used.iter().zip(views) {
        let truth = rendered.view.camera.centre();
        assert!(used.centre().distance(truth) < 1e-6 * truth.length(), "a camera left its place");
    }

    reconstruct(&scene, &trusted, &["--size", SIZE, "--trust-cameras"]).succeeded("trusted cameras");
    assert!(read_json(&trusted.join("report.json"))["camera_turn"].is_null());
    let [right, mended, trusted] = [right, mended, trusted].map(|out| share(&out));
    println!("within 1 %: {right:.3} of right cameras, {mended:.3} of mended ones, {trusted:.3} of misled ones");
    assert!(mended > right - 0.02 && mended > trusted + 0.1, "{right} {mended} {trusted}");
}
