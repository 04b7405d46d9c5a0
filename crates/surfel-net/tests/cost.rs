//! What the networks for the CPU cost: a process of its own, so that nothing else draws from the generator of weights.

use surfel_net::{Cost, NetConfig, Preset};

/// At most 2 million parameters; the multiplications as they are, so that whoever widens a layer sees what it costs.
/// Fresh surfels of `Narrow` are drawn, and how many pixels they ask with them.
#[test]
fn the_networks_for_the_cpu_are_small() {
    for (preset, giga) in [(Preset::Small, 24.90), (Preset::Narrow, 16.15)] {
        let cost = Cost::of(&NetConfig::preset(preset), (320, 256)).unwrap().unwrap();
        assert!(cost.num_parameters() <= 2_000_000, "{preset:?}: {cost:?}");
        let counted = cost.multiply_adds as f64 / 1e9;
        assert!((counted - giga).abs() < 0.05, "{preset:?}: {counted} instead of {giga}");
    }
}
