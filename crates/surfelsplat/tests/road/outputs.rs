//! Every file that is promised exists, opens, and says the same as the others.

use crate::command::{SIZE, reconstruct, surfelsplat};
use crate::read_back::{files_below, ply_header, read_mesh};
use crate::scene_files::{height_field, image_name, read_json, write, write_scene};
use serde_json::Value;
use std::path::Path;
use std::sync::OnceLock;
use surfel_core::Grid;
use surfel_io::depth::read_pfm;
use tempfile::TempDir;

/// One reconstruction that several tests read: `scene/` and `out/` in a folder.
fn reconstruction() -> &'static Path {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        write_scene(&folder.path().join("scene"), &height_field()[..2]);
        run(folder.path(), "out", &[]);
        folder
    });
    folder.path()
}

fn run(folder: &Path, out: &str, more: &[&str]) -> crate::command::Run {
    let args = [&["--size", SIZE], more].concat();
    reconstruct(&folder.join("scene"), &folder.join(out), &args).succeeded(out)
}

#[test]
fn all_promised_files_are_there_and_nothing_else() {
    let mut expected: Vec<String> =
        ["cameras.json", "mesh.glb", "mesh.ply", "preview.png", "report.json", "surfels.ply"].map(str::to_owned).into();
    for stem in ["00", "01"] {
        expected.extend(
            ["confidence/{}.png", "depth/{}.json", "depth/{}.pfm", "depth/{}.png", "normal/{}.png"]
                .map(|f| f.replace("{}", stem)),
        );
    }
    expected.sort();
    assert_eq!(files_below(&reconstruction().join("out")), expected);
}

#[test]
fn the_meshes_hold_the_same_surface() {
    let out = reconstruction().join("out");
    let mesh = read_mesh(&out.join("mesh.ply"));
    let (positions, triangles) = (&mesh.positions, &mesh.triangles);
    assert!(triangles.len() > 5000, "{} triangles", triangles.len());
    let glb = std::fs::read(out.join("mesh.glb")).unwrap();
    let word = |at: usize| u32::from_le_bytes(glb[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&glb[..4], word(4), word(8), &glb[16..20]), (&b"glTF"[..], 2, glb.len(), &b"JSON"[..]));
    let document: Value = serde_json::from_slice(&glb[20..20 + word(12)]).unwrap();
    let primitive = &document["meshes"][0]["primitives"][0];
    let count =
        |accessor: &Value| document["accessors"][accessor.as_u64().unwrap() as usize]["count"].as_u64().unwrap();
    assert_eq!(count(&primitive["attributes"]["POSITION"]), positions.len() as u64);
    assert_eq!(count(&primitive["attributes"]["COLOR_0"]), positions.len() as u64);
    assert_eq!(count(&primitive["indices"]), 3 * triangles.len() as u64);
}

#[test]
fn surfels_open_in_splat_viewers() {
    let header = ply_header(&reconstruction().join("out/surfels.ply"));
    for property in ["x", "y", "z", "f_dc_0", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_3"] {
        assert!(header.iter().any(|line| line == &format!("property float {property}")), "{property}: {header:?}");
    }
    let count = header.iter().find_map(|line| line.strip_prefix("element vertex ")).unwrap();
    assert!(count.parse::<usize>().unwrap() > 160 * 128);
}

#[test]
fn the_maps_have_the_working_size_and_sensible_values() {
    let out = reconstruction().join("out");
    let report = read_json(&out.join("report.json"));
    for (index, stem) in ["00", "01"].into_iter().enumerate() {
        let depth = read_pfm(&out.join(format!("depth/{stem}.pfm"))).unwrap();
        assert_eq!((depth.width(), depth.height()), (160, 128));
        let [near, far] = ["near", "far"].map(|key| report["views"][index][key].as_f64().unwrap() as f32);
        let inside = |z: &&f32| **z == 0.0 || (0.9 * near..1.1 * far).contains(*z);
        assert_eq!(depth.as_slice().iter().filter(inside).count(), depth.len(), "depth outside {near} to {far}");
        assert_same_depth(&depth, &out.join(format!("depth/{stem}")));
        let normal = image::open(out.join(format!("normal/{stem}.png"))).unwrap();
        let confidence = image::open(out.join(format!("confidence/{stem}.png"))).unwrap();
        assert_eq!((normal.width(), normal.height()), (160, 128));
        assert_eq!((confidence.width(), confidence.height()), (160, 128));
        assert!(normal.color().has_color() && !confidence.color().has_color());
    }
    let preview = image::open(out.join("preview.png")).unwrap();
    assert!(preview.width() > 4 * 160 && preview.height() > 2 * 128, "{}x{}", preview.width(), preview.height());
}

/// The 16-bit PNG beside a depth map, in the unit its sidecar states, agrees to half a step.
fn assert_same_depth(depth: &Grid<f32>, stem: &Path) {
    let png = image::open(stem.with_extension("png")).unwrap();
    assert_eq!(png.color(), image::ColorType::L16);
    let sidecar = read_json(&stem.with_extension("json"));
    let unit = sidecar["unit_per_count"].as_f64().unwrap();
    for (z, count) in depth.as_slice().iter().zip(png.into_luma16().into_raw()) {
        assert!((f64::from(*z) - f64::from(count) * unit).abs() <= 0.51 * unit, "{z} against {count} of {unit}");
    }
}

#[test]
fn the_report_tells_what_was_chosen_and_how_long_it_took() {
    let report = read_json(&reconstruction().join("out/report.json"));
    assert_eq!(report["version"], env!("CARGO_PKG_VERSION"));
    assert!(report["format"].as_str().unwrap().contains("cameras.json"), "{report}");
    let number = |value: &Value| value.as_f64().filter(|n| *n > 0.0).unwrap_or_else(|| panic!("{value} in {report}"));
    for view in report["views"].as_array().unwrap() {
        assert!(number(&view["near"]) < number(&view["far"]));
        assert!(!view["range_from"].as_str().unwrap().is_empty());
        assert!(number(&view["share_with_depth"]) > 0.8, "{view}");
        number(&view["num_candidates"]);
    }
    for key in ["vertices", "triangles", "voxel", "truncation"] {
        number(&report["mesh"][key]);
    }
    let stages: Vec<&str> =
        report["timings"].as_array().unwrap().iter().map(|t| t["stage"].as_str().unwrap()).collect();
    assert_eq!(stages, ["read", "check", "features", "depth", "surfels", "render", "mesh", "write"]);
    assert_eq!(report["camera_checks"][0]["status"], "Good");
    number(&report["total_ms"]);
    number(&report["threads"]);
}

#[test]
fn the_output_cameras_are_a_scene_again() {
    let folder = tempfile::tempdir().unwrap();
    let again = folder.path().join("scene");
    write_scene(&again, &height_field()[..2]);
    std::fs::copy(reconstruction().join("out/cameras.json"), again.join("cameras.json")).unwrap();
    let cameras = read_json(&again.join("cameras.json"));
    assert_eq!(cameras[1]["image"], image_name(1));
    let report = run(folder.path(), "out", &["--json"]);
    let report: Value = serde_json::from_str(&report.stdout).unwrap();
    assert_eq!(report["views"][0]["range_from"], "Stated by the camera file.");
    let [first, second] = [reconstruction(), folder.path()].map(|f| read_mesh(&f.join("out/mesh.ply")));
    assert_eq!(first.positions.len(), second.positions.len());
}

#[test]
fn foreign_files_in_the_output_folder_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    write_scene(&folder.path().join("scene"), &height_field()[..2]);
    for name in ["out/notes.txt", "out/depth/mine.pfm", "out/mesh.ply"] {
        write(&folder.path().join(name), "mine");
    }
    run(folder.path(), "out", &[]);
    for name in ["out/notes.txt", "out/depth/mine.pfm"] {
        assert_eq!(std::fs::read_to_string(folder.path().join(name)).unwrap(), "mine");
    }
    assert!(read_mesh(&folder.path().join("out/mesh.ply")).triangles.len() > 5000);
    assert!(files_below(&folder.path().join("out")).iter().all(|name| !name.contains("partial")));
}

#[test]
fn json_goes_to_stdout_alone_and_quiet_is_silent() {
    let folder = reconstruction();
    let json = run(folder, "json", &["--json"]);
    let printed: Value = serde_json::from_str(&json.stdout).unwrap();
    assert_eq!(printed, read_json(&folder.join("json/report.json")));
    let quiet = run(folder, "quiet", &["--quiet"]);
    assert_eq!((quiet.stdout.as_str(), quiet.stderr.as_str()), ("", ""));
    let missing = folder.join("nothing");
    let failed = surfelsplat(["reconstruct", missing.to_str().unwrap(), "-o", "out", "--json", "--quiet"]);
    assert_eq!(failed.code, Some(1));
    let error: Value = serde_json::from_str(&failed.stdout).unwrap();
    assert!(error["error"].as_str().unwrap().contains("nothing") && failed.stderr.contains("nothing"), "{error}");
}

#[test]
fn the_same_input_gives_the_same_bytes_on_any_number_of_threads() {
    let folder = reconstruction();
    run(folder, "one", &["--threads", "1"]);
    run(folder, "two", &["--threads", "2"]);
    for name in files_below(&folder.join("out")) {
        if name == "report.json" {
            continue;
        }
        let [first, one, two] = ["out", "one", "two"].map(|out| std::fs::read(folder.join(out).join(&name)).unwrap());
        assert!(first == one && one == two, "{name} differs between runs");
    }
}
