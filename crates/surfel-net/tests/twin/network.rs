//! Whole graphs whose size must be padded: `tiny` on three views, and a seeded network on two.

use super::fixture::{Fixture, out};
use super::head::surfel_outputs;
use super::{config, device};
use crate::config::SeededConfig;
use crate::{DepthRange, NetConfig, Preset, SceneInput, Seed, SurfelNet};
use surfel_core::Grid;

const RANGES: [(f64, f64); 3] = [(1.5, 6.0), (1.4, 5.0), (1.6, 7.0)];

/// Maps of `N` channels per view.
fn maps<const N: usize>(fixture: &Fixture, key: &str, (width, height): (usize, usize)) -> Vec<Grid<[f32; N]>> {
    let values = fixture.values(&format!("given.{key}"));
    let views = values.chunks_exact(N * width * height);
    let map =
        |view: &[f32]| Grid::from_fn(width, height, |x, y| std::array::from_fn(|c| view[(c * height + y) * width + x]));
    views.map(map).collect()
}

fn assert_equal(fixture: &Fixture, config: NetConfig, size: (usize, usize), seeds: &[Seed]) {
    let images = maps(fixture, "images", size);
    let cameras = fixture.cameras(size.0, size.1);
    let ranges: Vec<_> = RANGES.iter().map(|&(near, far)| DepthRange { near, far }).take(images.len()).collect();
    let scene = SceneInput { images: &images, cameras: &cameras, ranges: &ranges, seeds };
    fixture.assert_equal(SurfelNet::new(config, &device()).unwrap(), |net| {
        let prediction = net.forward(&scene, &device()).unwrap();
        let mut outputs = surfel_outputs(prediction.surfels);
        outputs.extend([
            out("initial_scales", prediction.initial.scales),
            out("initial_rotations", prediction.initial.rotations),
            out("depth", prediction.maps.depth),
            out("confidence", prediction.maps.confidence),
        ]);
        outputs
    });
}

#[test]
fn the_tiny_network_equals_its_twin() {
    assert_equal(&Fixture::open("network"), NetConfig::preset(Preset::Tiny), (20, 12), &[]);
}

#[test]
fn the_seeded_network_equals_its_twin() {
    let (fixture, size) = (Fixture::open("seeded_network"), (18, 11));
    let mut config = config();
    (config.transformer, config.cost_volume) = (None, None);
    config.seeded = Some(SeededConfig { distances: vec![2, 5], passes: 2, moves_depth: true });
    let (planes, evidence) = (maps(&fixture, "planes", size), maps(&fixture, "evidence", size));
    let [correlation, confidence] = ["correlation", "confidence"].map(|key| maps::<1>(&fixture, key, size));
    let seeds: Vec<Seed> = (0..2)
        .map(|v| Seed {
            planes: planes[v].clone(),
            evidence: evidence[v].clone(),
            correlation: correlation[v].map(|value| value[0]),
            confidence: confidence[v].map(|value| value[0]),
            step: fixture.values("given.step")[v],
        })
        .collect();
    assert_equal(&fixture, config, size, &seeds);
}
