//! Broken scenes: each must be refused with a sentence that names the file and the fault.

use crate::written::{self, golden, write, write_images};
use std::path::Path;
use surfel_io::Scene;

type Writer = fn(&Path, &[surfel_core::Camera]);
type Breakage = fn(&Path);

fn replace(folder: &Path, file: &str, from: &str, to: &str) {
    let text = std::fs::read_to_string(folder.join(file)).unwrap();
    assert!(text.contains(from), "{file} has no {from:?}");
    write(folder, file, text.replacen(from, to, 1));
}

fn truncate(folder: &Path, file: &str, keep: f64) {
    let bytes = std::fs::read(folder.join(file)).unwrap();
    write(folder, file, &bytes[..(keep * bytes.len() as f64) as usize]);
}

fn edit_line(folder: &Path, file: &str, line: usize, edit: fn(Vec<f64>) -> Vec<f64>) {
    let text = std::fs::read_to_string(folder.join(file)).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let numbers = edit(lines[line].split_whitespace().map(|n| n.parse().unwrap()).collect());
    lines[line] = numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    write(folder, file, lines.join("\n"));
}

/// What is broken, in which format, how, and what the message must say.
const CASES: [(&str, Writer, Breakage, &[&str]); 19] = [
    ("truncated npz", written::idr, |f| truncate(f, "cameras_sphere.npz", 0.5), &["cameras_sphere.npz", "complete"]),
    ("empty npz", written::idr, |f| write(f, "cameras_sphere.npz", b""), &["cameras_sphere.npz"]),
    ("empty json", written::transforms, |f| write(f, "transforms.json", ""), &["transforms.json"]),
    ("json without frames", written::transforms, |f| write(f, "transforms.json", "{}"), &["transforms.json", "frames"]),
    ("cut json", written::cameras_json, |f| truncate(f, "cameras.json", 0.7), &["cameras.json"]),
    (
        "no focal length",
        written::transforms_per_frame,
        |f| {
            replace(f, "transforms.json", "fl_x", "f");
            replace(f, "transforms.json", "fl_y", "g")
        },
        &["transforms.json", "images/000000.png"],
    ),
    (
        "negative focal length",
        written::cameras_json,
        |f| replace(f, "cameras.json", "[120", "[-120"),
        &["cameras.json", "000000.png", "focal"],
    ),
    (
        "unknown model",
        written::transforms,
        |f| replace(f, "transforms.json", "\"OPENCV\"", "\"EQUIRECTANGULAR\""),
        &["transforms.json", "EQUIRECTANGULAR"],
    ),
    (
        "unknown COLMAP model",
        written::colmap_text,
        |f| replace(f, "sparse/0/cameras.txt", "PINHOLE", "EUCM"),
        &["cameras.txt", "EUCM", "image_undistorter"],
    ),
    (
        "missing COLMAP camera",
        written::colmap_text,
        |f| replace(f, "sparse/0/cameras.txt", "7 PIN", "8 PIN"),
        &["images.txt", "camera 7"],
    ),
    (
        "word for a number",
        written::colmap_text,
        |f| replace(f, "sparse/0/cameras.txt", "118.5", "wide"),
        &["cameras.txt", "line 2", "wide"],
    ),
    (
        "cut COLMAP binary",
        written::colmap_binary,
        |f| truncate(f, "sparse/0/images.bin", 0.6),
        &["images.bin", "cut short"],
    ),
    (
        "NaN pose",
        written::poses_text,
        |f| {
            edit_line(f, "poses.txt", 1, |mut n| {
                n[3] = f64::NAN;
                n
            })
        },
        &["poses.txt", "000001", "finite"],
    ),
    (
        "mirrored pose",
        written::poses_text,
        |f| {
            edit_line(f, "poses.txt", 2, |mut n| {
                n[..3].iter_mut().for_each(|x| *x = -*x);
                n
            })
        },
        &["poses.txt", "000002", "mirror"],
    ),
    (
        "scaled rotation",
        written::poses_text,
        |f| {
            edit_line(f, "poses.txt", 0, |mut n| {
                n[..3].iter_mut().for_each(|x| *x *= 2.0);
                n
            })
        },
        &["poses.txt", "000000", "not a rotation"],
    ),
    (
        "transposed pose",
        written::poses_text,
        |f| edit_line(f, "poses.txt", 0, |n| (0..16).map(|i| n[i % 4 * 4 + i / 4]).collect()),
        &["poses.txt", "transposed"],
    ),
    (
        "frames.txt of another length",
        written::poses_text,
        |f| write(f, "frames.txt", "000000\n"),
        &["poses.txt", "4 poses", "1 frames"],
    ),
    (
        "all images missing",
        written::colmap_text,
        |f| std::fs::remove_dir_all(f.join("images")).unwrap(),
        &["sparse/0", "0 of its 4", "000000.png"],
    ),
    (
        "images of another shape",
        written::colmap_text,
        |f| written::coordinates_picture(50, 64).save(f.join(written::image_name(2))).unwrap(),
        &["000002.png", "96x64", "50x64"],
    ),
];

#[test]
fn broken_scenes_are_refused_by_name() {
    for (what, writer, breakage, expected) in CASES {
        let folder = tempfile::tempdir().unwrap();
        let cameras = golden(false);
        write_images(folder.path(), cameras.len());
        writer(folder.path(), &cameras);
        breakage(folder.path());
        let message = match Scene::open(folder.path()) {
            Err(error) => error.to_string(),
            Ok(scene) => panic!("{what}: opened as {}", scene.format),
        };
        for part in expected {
            assert!(message.contains(part), "{what}: {part:?} is not in {message:?}");
        }
    }
}

#[test]
fn one_unreadable_photograph_is_left_out_aloud() {
    let folder = tempfile::tempdir().unwrap();
    write_images(folder.path(), 4);
    written::transforms(folder.path(), &golden(false));
    write(folder.path(), &written::image_name(2), "not a picture");
    let scene = Scene::open(folder.path()).unwrap();
    assert_eq!(scene.frames.len(), 3);
    assert!(scene.warnings.iter().any(|warning| warning.contains("000002.png")), "{:?}", scene.warnings);
}

#[test]
fn a_missing_folder_is_named() {
    let message = Scene::open(Path::new("no/such/folder")).unwrap_err().to_string();
    assert!(message.contains("no/such/folder"), "{message}");
}
