//! One set of cameras, written in every format, is read back the same.

use crate::written::{self, golden, write_images};
use glam::DVec3;
use std::path::Path;
use surfel_core::{Camera, Lens, lens::Polynomial};
use surfel_io::{FormatKind, Scene};

type Writer = fn(&Path, &[Camera]);

const GENERAL: [(FormatKind, Writer); 13] = [
    (FormatKind::Colmap, written::colmap_text),
    (FormatKind::Colmap, written::colmap_binary),
    (FormatKind::Transforms, written::transforms),
    (FormatKind::Transforms, written::transforms_per_frame),
    (FormatKind::Idr, written::idr),
    (FormatKind::RobustMvd, written::robustmvd),
    (FormatKind::MvsNet, written::mvsnet),
    (FormatKind::RealEstate10k, written::re10k),
    (FormatKind::CamerasJson, written::cameras_json),
    (FormatKind::CamerasJson, written::cameras_json_with_centres),
    (FormatKind::Middlebury, written::middlebury),
    (FormatKind::Strecha, written::strecha),
    (FormatKind::PosesText, written::poses_text),
];
/// Formats that can only say a centred principal point, or are written with an extra file.
const CENTRED: [(FormatKind, Writer); 3] = [
    (FormatKind::Transforms, written::blender),
    (FormatKind::Llff, written::llff),
    (FormatKind::TrajectoryLog, written::trajectory_log),
];

fn opened(writer: Writer, cameras: &[Camera]) -> (tempfile::TempDir, Scene) {
    let folder = tempfile::tempdir().unwrap();
    write_images(folder.path(), cameras.len());
    writer(folder.path(), cameras);
    let scene = Scene::open(folder.path()).unwrap_or_else(|error| panic!("{error}"));
    (folder, scene)
}

#[test]
fn every_format_gives_the_same_cameras() {
    let general = GENERAL.map(|(kind, writer)| (kind, writer, golden(false)));
    let centred = CENTRED.map(|(kind, writer)| (kind, writer, golden(true)));
    for (kind, writer, cameras) in general.into_iter().chain(centred) {
        let (_folder, scene) = opened(writer, &cameras);
        assert_eq!((scene.format.kind, scene.frames.len()), (kind, cameras.len()), "{}", scene.format);
        assert_eq!(scene.format.num_cameras, 1);
        for (index, (frame, expected)) in scene.frames.iter().zip(&cameras).enumerate() {
            let got = frame.pinhole();
            let (k, l) = (got.intrinsics, expected.intrinsics);
            let worst = [k.fx - l.fx, k.fy - l.fy, k.cx - l.cx, k.cy - l.cy].iter().fold(0.0f64, |m, d| m.max(d.abs()));
            assert!(worst < 1e-6, "{}: frame {index}: {k:?} instead of {l:?}", scene.format);
            let (a, b) = (got.camera_from_world.to_mat4(), expected.camera_from_world.to_mat4());
            assert!(a.abs_diff_eq(b, 1e-6), "{}: frame {index}: {a} instead of {b}", scene.format);
            assert_eq!(frame.image_path, scene.root.join(written::image_name(index)), "{}", scene.format);
            assert_eq!((got.width, got.height), (expected.width, expected.height));
        }
        let warned = !scene.warnings.is_empty();
        assert_eq!(warned, kind == FormatKind::Strecha, "{}: {:?}", scene.format, scene.warnings);
    }
}

#[test]
fn depth_ranges_are_read_where_a_format_has_them() {
    let expectations: [(Writer, (f64, f64)); 4] = [
        (written::cameras_json, (2.0, 9.0)),
        (written::llff, (2.0, 9.0)),
        (written::mvsnet, (2.5, 2.5 + 0.5 * 191.0)),
        (written::idr, (2.7, 5.7)),
    ];
    for (writer, expected) in expectations {
        let (_folder, scene) = opened(writer, &golden(true));
        let (near, far) = scene.frames[0].near_far.unwrap();
        assert!((near - expected.0).abs() < 0.1 && (far - expected.1).abs() < 0.1, "{}: {near} {far}", scene.format);
    }
}

#[test]
fn sparse_points_know_the_frames_that_see_them() {
    for writer in [written::colmap_text, written::colmap_binary] {
        let (_folder, scene) = opened(writer, &golden(false));
        assert_eq!(scene.points.len(), 1);
        assert_eq!(scene.points[0].position, DVec3::new(0.5, -0.25, 1.0));
        assert_eq!(scene.points[0].seen_by, [0, 2]);
    }
}

#[test]
fn distortion_is_the_same_lens_in_every_format_that_has_it() {
    let cameras = golden(false);
    let expected = Lens::perspective(Polynomial::opencv(&[0.1, -0.05, 0.002, 0.001]));
    let in_place = |folder: &Path, file: &str, from: &str, to: &str| {
        let text = std::fs::read_to_string(folder.join(file)).unwrap();
        assert!(text.contains(from));
        written::write(folder, file, text.replace(from, to));
    };
    let edits: [(Writer, &str, &str, &str); 3] = [
        (
            written::colmap_text,
            "sparse/0/cameras.txt",
            "PINHOLE 96 64 120 118.5 46.75 33.25",
            "OPENCV 96 64 120 118.5 46.75 33.25 0.1 -0.05 0.002 0.001",
        ),
        (
            written::transforms,
            "transforms.json",
            r#""fl_x""#,
            r#""k1": 0.1, "k2": -0.05, "p1": 0.002, "p2": 0.001, "fl_x""#,
        ),
        (written::cameras_json, "cameras.json", r#""near""#, r#""distortion": [0.1, -0.05, 0.002, 0.001], "near""#),
    ];
    for (writer, file, from, to) in edits {
        let (folder, _) = opened(writer, &cameras);
        in_place(folder.path(), file, from, to);
        let scene = Scene::open(folder.path()).unwrap();
        assert_eq!(scene.frames[3].lens, expected, "{}", scene.format);
    }
}

#[test]
fn the_written_cameras_json_is_read_back_exactly() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = golden(false);
    write_images(folder.path(), cameras.len());
    let names: Vec<String> = (0..cameras.len()).map(written::image_name).collect();
    let records: Vec<_> = cameras
        .iter()
        .zip(&names)
        .map(|(camera, image)| surfel_io::write::cameras_json::CameraRecord {
            image,
            camera,
            near_far: Some((1.0, 5.0)),
        })
        .collect();
    let mut bytes = Vec::new();
    surfel_io::write::cameras_json::write_cameras_json(&mut bytes, &records).unwrap();
    written::write(folder.path(), "cameras.json", bytes);
    let scene = Scene::open(folder.path()).unwrap();
    for (frame, camera) in scene.frames.iter().zip(&cameras) {
        assert_eq!(frame.intrinsics, camera.intrinsics);
        assert!(frame.camera_from_world.to_mat4().abs_diff_eq(camera.camera_from_world.to_mat4(), 1e-12));
        assert_eq!(frame.near_far, Some((1.0, 5.0)));
    }
}
