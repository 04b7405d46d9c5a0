//! `surfelsplat eval synth`: the truth scores perfectly, matching well, and both the same twice.

use crate::command::surfelsplat;
use crate::tables::table;
use surfel_net::{Device, NetConfig, Preset, SurfelNet, checkpoint};

const DEPTH: &str = "Depth and normals, mean";
const SURFACE: &str = "Surface of the objects, mean";

#[test]
fn the_truth_is_perfect_matching_is_good_and_files_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let args =
        ["eval", "synth", "--kind", "sphere,still-life", "--seeds", "0..2", "--size", "160x128", "--spacing", "4"];
    let run = surfelsplat(args.into_iter().chain(["--json", "-o", out.to_str().unwrap()])).succeeded("eval synth");
    let (depth, surface) = (table(&run.stdout, DEPTH), table(&run.stdout, SURFACE));
    assert_eq!(table(&run.stdout, "Depth and normals per scene").len(), 6);
    let exact = |column: &str| depth.number(&["exact", "160x128"], column);
    assert_eq!((exact("within 1 %"), exact("coverage"), exact("median error, objects")), (1.0, 1.0, 0.0));
    assert!(exact("normals, deg") < 1e-3 && exact("normal MSE (sum)") < 1e-9);
    // The normals of an exact but discrete depth map are wrong across its edges.
    assert!(exact("normals of depth, deg") < 6.0);
    let matching = |column: &str| depth.number(&["matching", "160x128"], column);
    assert!(matching("within 1 %, objects") > 0.85, "{}", run.stdout);
    assert!(matching("median error, objects") < 3.0 && matching("normals, deg") < 25.0, "{}", run.stdout);
    assert!((matching("normal MSE (sum)") / matching("normal MSE (/3)") - 3.0).abs() < 1e-9);
    let network = depth.number(&["network", "160x128"], "within 1 %, objects");
    assert!(network > matching("within 1 %, objects") - 0.02, "{}", run.stdout);
    let chamfer = |method: &str| surface.column(&[method], "Chamfer")[0].as_f64().unwrap();
    // Points 4 mm and pixels 2 mm apart: that much no method can do without.
    assert!(chamfer("exact") < 2.0 && chamfer("matching") < chamfer("exact") + 3.0, "{}", run.stdout);
    assert!(chamfer("matching") > chamfer("exact"));
    for file in ["report.md", "report.json"] {
        assert!(out.join(file).is_file(), "{file}");
    }
    let written = std::fs::read_to_string(out.join("report.json")).unwrap();
    assert_eq!(written.trim(), run.stdout.trim());
}

#[test]
fn a_seed_gives_the_same_scores_twice() {
    let scores = || {
        let args = ["eval", "synth", "--kind", "torus", "--seeds", "5", "--size", "96x80", "--spacing", "6", "--json"];
        let run = surfelsplat(args.into_iter().chain(["--method", "matching"])).succeeded("eval synth");
        let columns = ["within 1 %", "median error, objects", "normals, deg"];
        let depth = table(&run.stdout, DEPTH);
        let chamfer = table(&run.stdout, SURFACE).column(&["matching"], "Chamfer");
        (columns.map(|column| depth.number(&["matching"], column)), chamfer)
    };
    assert_eq!(scores(), scores());
}

#[test]
fn an_unknown_method_is_refused_by_the_list_of_known_ones() {
    let run = surfelsplat(["eval", "synth", "--method", "magic"]);
    assert!(run.code == Some(2) && run.stderr.contains("exact, matching"), "{}", run.stderr);
}

#[test]
fn a_network_joins_by_name_and_an_untrained_one_is_matching() {
    let folder = tempfile::tempdir().unwrap();
    let weights = folder.path().join("fresh.safetensors");
    let net = SurfelNet::new(NetConfig::preset(Preset::Small), &Device::flex()).unwrap();
    checkpoint::save(&net, &weights).unwrap();
    let network = format!("fresh={}", weights.display());
    let args = ["eval", "synth", "--kind", "sphere", "--seeds", "0", "--size", "128x96", "--spacing", "6", "--json"];
    let more = ["--method", "matching", "--network", &network];
    let run = surfelsplat(args.into_iter().chain(more)).succeeded("eval synth");
    let depth = table(&run.stdout, DEPTH);
    let within = |method: &str| depth.number(&[method], "within 1 %, objects");
    assert!((within("fresh") - within("matching")).abs() < 0.05, "{}", run.stdout);
    let missing = surfelsplat(["eval", "synth", "--network", "small=nowhere.safetensors"]);
    assert!(missing.code == Some(1) && missing.stderr.contains("nowhere.safetensors"), "{}", missing.stderr);
}
