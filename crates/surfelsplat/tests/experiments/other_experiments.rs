//! `surfelsplat eval nvs`, `efficiency` and `ablation` on one tiny reconstructed scene.

use crate::command::{reconstruct, surfelsplat};
use crate::tables::table;
use std::path::{Path, PathBuf};

/// A scene of three photographs and a reconstruction from the first two, in a folder.
fn reconstructed(folder: &Path) -> (PathBuf, PathBuf) {
    let export = ["synth", "export", "--kind", "height-field", "--seeds", "2", "--size", "128x104", "--spacing", "20"];
    let more = ["--views-per-scene", "3", "-o", folder.to_str().unwrap()];
    surfelsplat(export.into_iter().chain(more)).succeeded("export");
    let (scene, out) = (folder.join("height-field-2"), folder.join("out"));
    reconstruct(&scene, &out, &["--views", "00,01", "--size", "128x104"]).succeeded("reconstruct");
    (scene, out)
}

#[test]
fn a_view_that_was_held_out_looks_like_its_photograph_and_an_input_even_more() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, out) = reconstructed(folder.path());
    let report = folder.path().join("report");
    let nvs = |more: &[&str]| {
        let args = ["eval", "nvs", scene.to_str().unwrap(), out.to_str().unwrap(), "--json"];
        surfelsplat(args.iter().chain(more)).succeeded("eval nvs").stdout
    };
    let held_out = nvs(&["-o", report.to_str().unwrap()]);
    let views = table(&held_out, "New views");
    assert_eq!(views.len(), 2, "the third view and the mean: {held_out}");
    let of = |column: &str| views.number(&["images/02.png"], column);
    assert!(of("PSNR, covered") > 20.0 && of("coverage") > 0.6, "{held_out}");
    assert!(of("PSNR, covered") >= of("PSNR") && of("SSIM") > 0.3, "{held_out}");
    assert!(image::open(report.join("views.png")).is_ok());
    let input = table(&nvs(&["--targets", "00"]), "New views");
    assert!(input.number(&["images/00.png"], "PSNR") > of("PSNR"));
    assert!(input.number(&["images/00.png"], "SSIM") > of("SSIM"));
    assert!(held_out.contains("LPIPS is missing"), "{held_out}");
    let args = ["eval", "nvs", scene.to_str().unwrap(), out.to_str().unwrap(), "--lpips", "no.safetensors"];
    let refused = surfelsplat(args);
    assert!(refused.code == Some(1) && refused.stderr.contains("no.safetensors"), "{}", refused.stderr);
    let none = surfelsplat(["eval", "nvs", scene.to_str().unwrap(), "nowhere"]);
    assert!(none.code == Some(1) && none.stderr.contains("nowhere"), "{}", none.stderr);
}

#[test]
fn every_step_is_timed_as_often_as_asked() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, _) = reconstructed(folder.path());
    let args = ["eval", "efficiency", scene.to_str().unwrap(), "--views", "00,01", "--size", "96x80"];
    let run = surfelsplat(args.into_iter().chain(["--runs", "2", "--warm-up", "0", "--json"])).succeeded("efficiency");
    let parts = table(&run.stdout, "Parts");
    let name = scene.to_str().unwrap();
    let time = |part: &str, column: &str| parts.number(&[name, part], column);
    let everything = time("everything", "median s");
    assert!(time("everything", "fastest s") <= everything && everything <= time("everything", "slowest s"));
    let sum: f64 = ["photographs to surfels", "rasterizer", "meshing", "reading, checking, writing"]
        .map(|part| time(part, "fastest s"))
        .iter()
        .sum();
    assert!(sum <= time("everything", "slowest s"), "{sum}");
    assert_eq!(table(&run.stdout, "Steps").len(), 8);
    assert_eq!(table(&run.stdout, "Memory").number(&[name], "runs"), 2.0);
    assert!(!table(&run.stdout, "The paper's table 2").column(&["SurfelSplat (paper)"], "time").is_empty());
}

#[test]
fn an_ablation_changes_one_part_and_stands_beside_the_paper() {
    let args = ["eval", "ablation", "--kind", "torus", "--seeds", "3", "--size", "96x80", "--spacing", "6", "--json"];
    let run = surfelsplat(args).succeeded("eval ablation");
    let rows = table(&run.stdout, "One part left out");
    let names = ["network", "network-without-adaptation", "network-without-aggregation", "network-in-one-pass"];
    assert!(rows.len() == 4 && names.iter().all(|name| rows.number(&[name], "within 1 %") > 0.5), "{}", run.stdout);
    let methods = ["--method", "matching,matching-without-adaptation"];
    let run = surfelsplat(args.iter().chain(&methods)).succeeded("eval ablation");
    let rows = table(&run.stdout, "One part left out");
    let within = |method: &str| rows.number(&[method], "within 1 %");
    assert!(within("matching") > 0.5 && within("matching-without-adaptation") < within("matching"), "{}", run.stdout);
    assert_eq!(table(&run.stdout, "The paper's table 3").number(&["SurfelSplat (paper)"], "normal MSE"), 0.06);
    let one = surfelsplat(["eval", "ablation", "--method", "matching"]);
    assert!(one.code == Some(1) && one.stderr.contains("at least two"), "{}", one.stderr);
}
