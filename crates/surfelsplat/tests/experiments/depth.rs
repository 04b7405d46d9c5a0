//! `surfelsplat eval depth`: a known error scores what it is, whoever made the depth maps.

use crate::command::surfelsplat;
use crate::tables::table;
use image::{GrayImage, Luma};
use std::path::{Path, PathBuf};
use surfel_io::depth::read_pfm;
use surfel_io::write::pfm::write_pfm;

/// A scene of two views, 96x80, in `folder`, and depth maps that are one millimetre off, without the upper half of the
/// second.
fn scene_and_maps(folder: &Path) -> (PathBuf, PathBuf) {
    let export = ["synth", "export", "--kind", "height-field", "--seeds", "1", "--size", "96x80", "--spacing", "20"];
    surfelsplat(export.into_iter().chain(["-o", text(folder)])).succeeded("export");
    let (scene, out) = (folder.join("height-field-1"), folder.join("out"));
    std::fs::create_dir_all(out.join("depth")).unwrap();
    for stem in ["00", "01"] {
        let file = format!("depth/{stem}.pfm");
        let mut depth = read_pfm(&scene.join(&file)).unwrap().map(|&z| if z > 0.0 { z + 1.0 } else { 0.0 });
        if stem == "01" {
            depth.as_mut_slice()[..96 * 40].fill(0.0);
        }
        write_pfm(&mut std::fs::File::create(out.join(&file)).unwrap(), &depth).unwrap();
    }
    (scene, out)
}

#[test]
fn depth_one_millimetre_off_scores_one_millimetre_and_a_hole_is_a_miss() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, out) = scene_and_maps(folder.path());
    let report = folder.path().join("report");
    let args = ["eval", "depth", text(&scene), text(&out), "--json", "-o", text(&report)];
    let run = surfelsplat(args).succeeded("eval depth");
    let maps = table(&run.stdout, "Depth maps");
    for view in ["00", "01", "mean"] {
        assert!((maps.number(&[view], "median error") - 1.0).abs() < 1e-3);
    }
    assert_eq!(maps.number(&["00"], "coverage"), 1.0);
    let half = maps.number(&["01"], "coverage");
    assert!(half < 0.7 && (maps.number(&["01"], "within 1 %") - half).abs() < 1e-9);
    let (sum, mean) = (maps.number(&["00"], "normal MSE (sum)"), maps.number(&["00"], "normal MSE (/3)"));
    assert!(sum < 0.01 && (sum / mean - 3.0).abs() < 1e-9, "{sum} {mean}");
    let surface = table(&run.stdout, "Object Chamfer");
    let accuracy = surface.number(&["depth maps"], "accuracy");
    assert!(accuracy > 0.5 && accuracy < 1.2, "{accuracy}");
    assert!(report.join("report.md").is_file());
}

#[test]
fn masks_say_what_is_scored() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, out) = scene_and_maps(folder.path());
    let args = ["eval", "depth", text(&scene), text(&out), "--masks", "--json"];
    let refusal = surfelsplat(args);
    assert_eq!(refusal.code, Some(1));
    assert!(refusal.stderr.contains("00.png has no mask"), "{}", refusal.stderr);
    // The half that the second depth map has.
    let lower = GrayImage::from_fn(96, 80, |_, y| Luma([if y < 40 { 0 } else { 255 }]));
    std::fs::create_dir(scene.join("masks")).unwrap();
    for stem in ["00", "01"] {
        lower.save(scene.join(format!("masks/{stem}.png"))).unwrap();
    }
    let maps = table(&surfelsplat(args).succeeded("eval depth --masks").stdout, "Depth maps");
    for view in ["00", "01"] {
        assert_eq!(maps.number(&[view], "coverage"), 1.0);
    }
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}
