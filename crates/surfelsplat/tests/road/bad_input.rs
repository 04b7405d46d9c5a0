//! Whatever is wrong with the input: one sentence that names the file and the remedy, exit code 1, nothing written.

use crate::command::{SIZE, reconstruct};
use crate::scene_files::{height_field, image_name, read_json, sphere, write, write_json, write_scene};
use serde_json::{Value, json};
use std::path::Path;

/// One way to go wrong, starting from a good scene of two photographs.
struct Case {
    what: &'static str,
    /// Breaks the scene folder.
    spoil: fn(&Path),
    args: &'static [&'static str],
    /// What the sentence must contain: the file and what to do about it.
    words: &'static [&'static str],
    /// 1 for bad input, 2 for a command line that cannot be meant.
    code: i32,
}

const GOOD: Case = Case { what: "", spoil: |_| (), args: &[], words: &[], code: 1 };

fn cameras(scene: &Path, edit: impl Fn(&mut Value)) {
    let path = scene.join("cameras.json");
    let mut cameras = read_json(&path);
    edit(&mut cameras);
    write_json(&path, &cameras);
}

fn truncate(path: &Path, keep: f64) {
    let bytes = std::fs::read(path).unwrap();
    write(path, &bytes[..(keep * bytes.len() as f64) as usize]);
}

fn picture(path: &Path, width: u32, height: u32) {
    image::GrayImage::new(width, height).save(path).unwrap();
}

const CASES: &[Case] = &[
    Case {
        what: "a photograph is missing",
        spoil: |scene| std::fs::remove_file(scene.join(image_name(1))).unwrap(),
        words: &["cameras.json", "images/01.png", "at least 2"],
        ..GOOD
    },
    Case {
        what: "a photograph is cut short",
        spoil: |scene| truncate(&scene.join(image_name(1)), 0.5),
        words: &["01.png", "complete"],
        ..GOOD
    },
    Case {
        what: "a photograph is empty",
        spoil: |scene| write(&scene.join(image_name(0)), ""),
        words: &["00.png", "complete"],
        ..GOOD
    },
    Case {
        what: "a photograph of another shape",
        spoil: |scene| picture(&scene.join(image_name(1)), 128, 160),
        words: &["cameras.json", "01.png", "160x128", "128x160", "crop"],
        ..GOOD
    },
    Case {
        what: "a photograph 20,000 pixels wide",
        spoil: |scene| {
            picture(&scene.join(image_name(0)), 20_000, 16);
            cameras(scene, |all| (all[0]["width"], all[0]["height"]) = (json!(20_000), json!(16)));
        },
        words: &["00.png", "20000", "smaller copy"],
        ..GOOD
    },
    Case {
        what: "NaN in a pose",
        spoil: |scene| {
            let text = std::fs::read_to_string(scene.join("cameras.json")).unwrap();
            let start = text.find("camera_from_world").unwrap() + "camera_from_world\":[[".len();
            let end = start + text[start..].find(',').unwrap();
            write(&scene.join("cameras.json"), format!("{}NaN{}", &text[..start], &text[end..]));
        },
        words: &["cameras.json"],
        ..GOOD
    },
    Case {
        what: "a pose that is no rotation",
        spoil: |scene| cameras(scene, |all| all[1]["camera_from_world"][0] = json!([2.0, 0.0, 0.0, 0.0])),
        words: &["cameras.json", "images/01.png", "not a rotation", "correct the pose"],
        ..GOOD
    },
    Case {
        what: "a pose that mirrors",
        spoil: |scene| {
            cameras(scene, |all| {
                let row = all[1]["camera_from_world"][0].as_array().unwrap().clone();
                all[1]["camera_from_world"][0] = row.iter().map(|n| json!(-n.as_f64().unwrap())).collect();
            });
        },
        words: &["cameras.json", "images/01.png", "mirror", "correct the pose"],
        ..GOOD
    },
    Case {
        what: "cameras that look away from each other",
        spoil: |scene| {
            // The second camera turned about its own vertical axis by half a turn.
            cameras(scene, |all| {
                for row in [0, 2] {
                    let turned: Value = all[1]["camera_from_world"][row]
                        .as_array()
                        .unwrap()
                        .iter()
                        .map(|n| json!(-n.as_f64().unwrap()))
                        .collect();
                    all[1]["camera_from_world"][row] = turned;
                }
            });
        },
        words: &["00", "01", "--trust-cameras"],
        ..GOOD
    },
    Case {
        what: "both photographs from one place",
        spoil: |scene| cameras(scene, |all| all[1]["camera_from_world"] = all[0]["camera_from_world"].clone()),
        words: &["00.png", "01.png", "zero baseline", "--views"],
        ..GOOD
    },
    Case {
        what: "photographs without cameras",
        spoil: |scene| std::fs::remove_file(scene.join("cameras.json")).unwrap(),
        words: &["scene", "no cameras", "COLMAP", "transforms.json"],
        ..GOOD
    },
    Case {
        what: "two scenes in one folder",
        spoil: |scene| {
            std::fs::remove_file(scene.join("cameras.json")).unwrap();
            std::fs::remove_dir_all(scene.join("images")).unwrap();
            write_scene(&scene.join("first"), &height_field()[..2]);
            write_scene(&scene.join("second"), &sphere()[..2]);
        },
        words: &["several scenes", "pass one of them", "scene/first", "scene/second"],
        ..GOOD
    },
    Case {
        what: "an npz that is no archive",
        spoil: |scene| {
            std::fs::remove_file(scene.join("cameras.json")).unwrap();
            write(&scene.join("cameras.npz"), "PK\x03\x04 and nothing more");
        },
        words: &["cameras.npz", "complete"],
        ..GOOD
    },
    Case {
        what: "an empty camera file",
        spoil: |scene| write(&scene.join("cameras.json"), ""),
        words: &["cameras.json", "image, width, height, K and camera_from_world"],
        ..GOOD
    },
    Case {
        what: "a camera file without cameras",
        spoil: |scene| write(&scene.join("cameras.json"), "[]"),
        words: &["cameras.json", "at least 2"],
        ..GOOD
    },
    Case {
        what: "a mask of another shape",
        spoil: |scene| {
            picture(&scene.join("mask.png"), 50, 90);
            cameras(scene, |all| all[0]["mask"] = json!("mask.png"));
        },
        words: &["mask.png", "50x90", "160x128", "draw it over"],
        ..GOOD
    },
    Case {
        what: "a mask that hides everything",
        spoil: |scene| {
            picture(&scene.join("mask.png"), 160, 128);
            cameras(scene, |all| all[0]["mask"] = json!("mask.png"));
        },
        words: &["mask.png", "00.png", "white"],
        ..GOOD
    },
    Case {
        what: "an unknown photograph is named",
        args: &["--views", "0,7"],
        words: &["scene", "\"7\"", "images/00.png"],
        ..GOOD
    },
    Case {
        what: "one photograph is named",
        args: &["--views", "1"],
        words: &["--views 1", "at least two", "scene"],
        ..GOOD
    },
    Case {
        what: "a photograph is named twice",
        args: &["--views", "0,00.png"],
        words: &["--views 0,00.png", "twice", "scene"],
        ..GOOD
    },
    Case {
        what: "more photographs than there are",
        args: &["--num-views", "5"],
        words: &["scene", "5 views", "has 2"],
        ..GOOD
    },
    Case {
        what: "a working size too small to match",
        args: &["--size", "16x16"],
        words: &["16x16", "--size", "32"],
        ..GOOD
    },
    Case {
        what: "near beyond far",
        args: &["--near", "3", "--far", "2"],
        words: &["--near", "--far", "3", "2"],
        ..GOOD
    },
    Case {
        what: "the scene does not exist",
        spoil: |scene| std::fs::remove_dir_all(scene).unwrap(),
        words: &["cannot read", "scene"],
        ..GOOD
    },
    Case {
        what: "another format is asked for",
        args: &["--format", "colmap"],
        words: &["scene", "colmap", "sparse"],
        ..GOOD
    },
    Case { what: "NaN near", args: &["--near", "nan"], words: &["--near", "above 0"], code: 2, ..GOOD },
    Case { what: "a size that is none", args: &["--size", "big"], words: &["--size", "320x256"], code: 2, ..GOOD },
    Case {
        what: "an unknown format",
        args: &["--format", "nerf"],
        words: &["--format", "transforms"],
        code: 2,
        ..GOOD
    },
];

fn entries(folder: &Path) -> Vec<String> {
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

/// Complaints about one case; empty when it is refused as it should be.
fn complaints(case: &Case) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    write_scene(&scene, &height_field()[..2]);
    (case.spoil)(&scene);
    let before = entries(folder.path());
    let size: &[&str] = if case.args.contains(&"--size") { &[] } else { &["--size", SIZE] };
    let run = reconstruct(&scene, &folder.path().join("out"), &[size, case.args].concat());
    let mut complaints = Vec::new();
    if run.code != Some(case.code) {
        complaints.push(format!("exit code {:?}, not {}", run.code, case.code));
    }
    if run.stderr.contains("panicked") {
        complaints.push("it panicked".to_owned());
    }
    complaints.extend(case.words.iter().filter(|word| !run.stderr.contains(**word)).map(|word| format!("no {word:?}")));
    if entries(folder.path()) != before {
        complaints.push(format!("left behind: {:?}", entries(folder.path())));
    }
    complaints.iter().map(|complaint| format!("{}: {complaint} in\n  {}", case.what, run.stderr)).collect()
}

#[test]
fn bad_input_is_refused_in_one_sentence_and_nothing_is_written() {
    let complaints: Vec<String> = CASES.iter().flat_map(complaints).collect();
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
}

#[test]
fn an_output_that_is_a_file_is_refused_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, out) = (folder.path().join("scene"), folder.path().join("out"));
    write_scene(&scene, &height_field()[..2]);
    write(&out, "precious");
    let run = reconstruct(&scene, &out, &["--size", SIZE]);
    assert_eq!(run.code, Some(1));
    assert!(run.stderr.contains("it is a file, not a folder") && run.stderr.contains("out"), "{}", run.stderr);
    assert_eq!(std::fs::read_to_string(&out).unwrap(), "precious");
    assert_eq!(entries(folder.path()), ["out", "scene"]);
}

#[test]
fn one_damaged_photograph_of_many_is_left_out_aloud() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    write_scene(&scene, height_field());
    write(&scene.join(image_name(2)), "not a picture");
    let run = reconstruct(&scene, &folder.path().join("out"), &["--size", SIZE]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stderr.contains("warning") && run.stderr.contains("02.png"), "{}", run.stderr);
}
