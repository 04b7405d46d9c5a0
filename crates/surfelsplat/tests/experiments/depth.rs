//! `surfelsplat eval depth`: a known error scores what it is, whoever made the depth maps.

use crate::command::surfelsplat;
use crate::tables::table;
use std::path::Path;
use surfel_io::depth::read_pfm;
use surfel_io::write::pfm::write_pfm;

#[test]
fn depth_one_millimetre_off_scores_one_millimetre_and_a_hole_is_a_miss() {
    let folder = tempfile::tempdir().unwrap();
    let export = ["synth", "export", "--kind", "height-field", "--seeds", "1", "--size", "96x80", "--spacing", "20"];
    surfelsplat(export.into_iter().chain(["-o", folder.path().to_str().unwrap()])).succeeded("export");
    let (scene, out) = (folder.path().join("height-field-1"), folder.path().join("out"));
    std::fs::create_dir_all(out.join("depth")).unwrap();
    for stem in ["00", "01"] {
        let file = format!("depth/{stem}.pfm");
        let mut depth = read_pfm(&scene.join(&file)).unwrap().map(|&z| if z > 0.0 { z + 1.0 } else { 0.0 });
        if stem == "01" {
            depth.as_mut_slice()[..96 * 40].fill(0.0);
        }
        write_pfm(&mut std::fs::File::create(out.join(&file)).unwrap(), &depth).unwrap();
    }
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

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}
