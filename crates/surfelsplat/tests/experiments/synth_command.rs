//! `surfelsplat synth`: pages, checks and folders of rendered scenes.

use crate::command::surfelsplat;
use crate::tables::table;
use glam::DVec3;
use surfel_core::Camera;
use surfel_eval::Reference;
use surfel_io::depth::read_pfm;
use surfel_io::ply::read_ply_file;
use surfel_io::scene::Scene;
use surfel_synth::{SceneKind, SceneOptions};

#[test]
fn a_sheet_shows_every_scene() {
    let folder = tempfile::tempdir().unwrap();
    let png = folder.path().join("sheet.png");
    let args = ["synth", "sheet", "--size", "40x32", "--seeds", "0..6", "-o", png.to_str().unwrap(), "--json"];
    let run = surfelsplat(args).succeeded("sheet");
    let said: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(said["scenes"].as_array().unwrap().len(), 6);
    assert_eq!(said["scenes"][3], "height-field-3");
    let picture = image::open(&png).unwrap().into_rgb8();
    // Two pictures, depth and normals per scene; four pixels of white between and around tiles.
    assert_eq!(picture.dimensions(), (4 + 4 * 44, 4 + 6 * 36));
}

#[test]
fn verify_passes_true_depth_and_fails_when_nothing_may_differ() {
    let args = ["synth", "verify", "--size", "96x80", "--seeds", "0..6", "--json"];
    let run = surfelsplat(args).succeeded("verify");
    let table = table(&run.stdout, "Colour difference");
    assert_eq!(table.len(), 12);
    assert!(table.number(&["sphere-0", "0 in 1"], "median") < 0.03);
    let strict = surfelsplat(args.into_iter().chain(["--max-median", "0.00001"]));
    assert_eq!(strict.code, Some(1));
    assert!(strict.stderr.contains("torus-1: view 0 warped into view 1 differs by"), "{}", strict.stderr);
}

#[test]
fn an_exported_scene_opens_and_says_what_is_true() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let args = ["synth", "export", "--kind", "sphere", "--seeds", "3", "--size", "96x80", "--spacing", "10", "-o", out];
    surfelsplat(args.into_iter().chain(["--masks"])).succeeded("export");
    let root = folder.path().join("sphere-3");
    let scene = Scene::open(&root).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert_eq!(scene.frames.len(), 2);
    assert!(scene.frames.iter().all(|frame| frame.mask_path.is_some()));
    let options = SceneOptions { kind: SceneKind::Sphere, seed: 3, width: 96, height: 80, ..SceneOptions::default() };
    for (frame, rendered) in scene.frames.iter().zip(options.render()) {
        let read = frame.pinhole();
        assert_eq!((read.intrinsics, read.width, read.height), (rendered.view.camera.intrinsics, 96, 80));
        assert_eq!(read_pfm(&root.join(format!("depth/{}.pfm", frame.stem()))).unwrap(), rendered.depth);
        let view = frame.load(96, 80).unwrap();
        assert_eq!(view.valid, rendered.object_mask());
        let worst = view
            .image
            .as_slice()
            .iter()
            .zip(rendered.view.image.as_slice())
            .flat_map(|(a, b)| [0, 1, 2].map(|i| (a[i] - b[i]).abs()));
        assert!(worst.fold(0.0, f32::max) <= 0.5 / 255.0 + 1e-6);
    }
    let points = read_ply_file(&root.join("truth/points.ply")).unwrap();
    assert!(points.positions.len() > 500 && points.normals.len() == points.positions.len());
    let cameras: Vec<Camera> = scene.frames.iter().map(|frame| frame.pinhole()).collect();
    for (p, n) in points.positions.iter().zip(&points.normals) {
        let (p, n) = (DVec3::from(p.map(f64::from)), DVec3::from(n.map(f64::from)));
        assert!((p.length() - options.object_radius).abs() < 1e-3 && p.normalize().dot(n) > 0.999);
        assert!(cameras.iter().any(|camera| (camera.centre() - p).dot(n) > 0.0), "{p} faces away from every camera");
    }
    let reference = Reference::open(&root).unwrap().unwrap();
    assert_eq!(reference.points().unwrap().unwrap().positions, points.positions);
}

#[test]
fn wrong_words_are_refused_with_what_can_be_said() {
    for (args, said) in [
        (["synth", "verify", "--kind", "teapot"], "still-life"),
        (["synth", "verify", "--seeds", "9..2"], "9..2"),
        (["synth", "verify", "--split", "train"], "--assets"),
    ] {
        let run = surfelsplat(args);
        assert!(run.code == Some(2) && run.stderr.contains(said), "{args:?}: {}", run.stderr);
    }
    let missing = surfelsplat(["synth", "verify", "--assets", "nowhere"]);
    assert!(missing.code == Some(1) && missing.stderr.contains("nowhere"), "{}", missing.stderr);
}
