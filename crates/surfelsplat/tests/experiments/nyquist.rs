//! `surfelsplat eval nyquist`: the adaptation does what the paper claims, and the report says how much was counted.

use crate::command::surfelsplat;
use crate::tables::table;
use std::f64::consts::PI;
use surfel_net::{Device, NetConfig, Preset, SurfelNet, checkpoint};

#[test]
fn no_surfel_breaks_the_criterion_after_adaptation_and_all_do_before() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let args = ["eval", "nyquist", "--kind", "height-field,sphere", "--seeds", "0..2", "--size", "96x80", "--json"];
    let run = surfelsplat(args.into_iter().chain(["-o", out.to_str().unwrap()])).succeeded("eval nyquist");
    let ratios = table(&run.stdout, "Surfel frequency over");
    let of = |reading: &str, state: &str, column: &str| ratios.number(&[reading, state], column);
    let counted = of("consistent", "before adaptation", "counted");
    // Two scenes of two views; a surfel per pixel, less what is not solid.
    assert!(counted > 0.5 * 4.0 * 96.0 * 80.0 && counted <= 4.0 * 96.0 * 80.0, "{counted}");
    // The road starts at 0.3 pixels of footprint, seen by the other view about as finely as by its own.
    let before = of("consistent", "before adaptation", "median ratio");
    assert!((before - 2.0 / (PI * 0.3)).abs() < 0.2, "{before}");
    assert!(of("consistent", "before adaptation", "above 1") > 0.99);
    for state in ["after adaptation", "final"] {
        assert_eq!(of("consistent", state, "above 1"), 0.0);
        assert!(of("consistent", state, "largest ratio") <= 2.0 / PI * (1.0 + 1e-5));
        assert_eq!(of("consistent", state, "counted"), counted);
    }
    // The literal reading keeps no such promise at this resolution, and says so instead of hiding it.
    assert!(of("paper, literal", "after adaptation", "counted") == counted);
    let svg = std::fs::read_to_string(out.join("nyquist.svg")).unwrap();
    assert!(svg.contains("consistent: after adaptation") && svg.contains("paper, literal: before adaptation"));
    assert!(std::fs::read_to_string(out.join("report.md")).unwrap().contains("(nyquist.svg)"));
}

#[test]
fn without_the_low_pass_the_measure_sees_it() {
    let args = ["eval", "nyquist", "--kind", "sphere", "--seeds", "0", "--size", "96x80", "--json"];
    let run = surfelsplat(args.into_iter().chain(["--method", "matching-without-adaptation"]));
    let run = run.succeeded("eval nyquist");
    assert!(table(&run.stdout, "Surfel frequency over").number(&["consistent", "final"], "above 1") > 0.99);
    let truth = surfelsplat(["eval", "nyquist", "--method", "exact"]);
    assert!(truth.code == Some(1) && truth.stderr.contains("makes no surfels"), "{}", truth.stderr);
}

#[test]
fn a_network_shows_its_own_three_states() {
    let folder = tempfile::tempdir().unwrap();
    let weights = folder.path().join("fresh.safetensors");
    let net = SurfelNet::new(NetConfig::preset(Preset::Small), &Device::flex()).unwrap();
    checkpoint::save(&net, &weights).unwrap();
    let network = format!("fresh={}", weights.display());
    let args = ["eval", "nyquist", "--kind", "sphere", "--seeds", "0", "--size", "128x96", "--json"];
    let run = surfelsplat(args.into_iter().chain(["--network", &network])).succeeded("eval nyquist");
    let ratios = table(&run.stdout, "Surfel frequency over");
    let of = |state: &str, column: &str| ratios.number(&["consistent", state], column);
    assert!(of("before adaptation", "counted") > 1000.0);
    assert!(of("after adaptation", "largest ratio") <= 2.0 / PI * (1.0 + 1e-4), "{}", run.stdout);
    assert!(of("after adaptation", "median ratio") < of("before adaptation", "median ratio"));
    assert!(run.stdout.contains("the first pass of the network's head"));
}
