//! Presets, refusals, and the sizes of the networks they describe.

use burn::tensor::Device;
use surfel_net::config::BackboneConfig;
use surfel_net::{ConfigError, NetConfig, Preset, SurfelNet};

const TINY: &str = include_str!("../../presets/tiny.toml");

#[test]
fn every_preset_parses() {
    for preset in [Preset::Paper, Preset::Small, Preset::Narrow, Preset::Tiny] {
        assert!(NetConfig::preset(preset).size_multiple() <= 64);
    }
    assert!(matches!(NetConfig::preset(Preset::Small).backbone, BackboneConfig::Pretrained { .. }));
}

#[test]
fn unknown_and_unusable_settings_are_refused_in_words() {
    for (from, to) in [
        ("num_layers = 2", "num_layers = 2\nlayers = 2"),
        ("widths = [8, 8]", "widths = [8, 8]\ndropout = 0.1"),
        ("num_neighbours = 2", "num_neighbors = 2"),
        ("kind = \"cnn\"", "kind = \"resnet\""),
        ("s = 1.0", ""),
    ] {
        assert!(TINY.contains(from));
        let error = NetConfig::from_toml(&TINY.replacen(from, to, 1)).unwrap_err();
        assert!(matches!(error, ConfigError::Syntax(_)), "{from}: {error}");
    }
    for (from, to, key) in [
        ("num_candidates = 16", "num_candidates = 1", "cost_volume.num_candidates"),
        ("num_candidates = 5", "num_candidates = 4", "refinement.sweep.num_candidates"),
        ("radius = 2", "radius = 4", "nyquist.radius"),
        ("epsilon = 0.1353353", "epsilon = nan", "nyquist.epsilon"),
        ("sh_degree = 1", "sh_degree = 4", "head.sh_degree"),
        ("num_heads = 2", "num_heads = 3", "aggregation.num_heads"),
        ("stride = 2", "stride = 3", "refinement.stride"),
        ("scale_min = 0.5", "scale_min = 50.0", "head.scale_max"),
    ] {
        assert!(TINY.contains(from));
        let error = NetConfig::from_toml(&TINY.replacen(from, to, 1)).unwrap_err();
        assert!(matches!(error, ConfigError::Value { key: k, .. } if k == key), "{from}: {error}");
        assert!(error.to_string().contains("it must be"), "{error}");
    }
}

/// Spec 2.10 (and 2.7.1, 2.7.4 for 163 features and 54 attributes).
#[test]
fn the_paper_network_has_the_papers_parameters() {
    let net = SurfelNet::new(NetConfig::preset(Preset::Paper), &Device::flex()).unwrap();
    let expected = [
        ("backbone", 1_049_120),
        ("transformer", 3_150_336),
        ("coarse depth", 5_862_144 + 32_896 + 590_208),
        ("refinement", 295_040 + 36_896 + 545_728 + 19_650),
        ("attribute head", 158_436 + 108 + 52_488 + 54),
        ("aggregation", 3 * (163 * 128 + 128) + 128 * 163 + 163 + 163 * 652 + 652 + 652 * 163 + 163 + 3 * 326),
    ];
    assert_eq!(net.parts(), expected);
}
