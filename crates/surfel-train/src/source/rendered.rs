//! Scenes that are rendered for a sample: scanned objects, or analytic shapes.
//!
//! Between the settings of a source and `surfel-synth`. Invariant: settings and seed name the pictures for good.

use super::config::{Scans, SourceConfig};
use surfel_synth::{
    AssetError, AssetLibrary, Random, RenderedView, SceneKind, SceneOptions, SceneSampler, SynthConfig,
};

/// Photographs scanned objects.
///
/// # Errors
/// When an asset cannot be read.
pub(super) fn scans(
    library: &AssetLibrary,
    config: &SourceConfig,
    scans: &Scans,
    seed: u64,
) -> Result<Vec<RenderedView>, AssetError> {
    let usual = SynthConfig::default();
    let synth = SynthConfig {
        width: config.width,
        height: config.height,
        num_views: config.num_views,
        room_share: scans.room_share,
        pair_angle_deg: scans.pair_angle_deg,
        exposure_stops: scans.defects * usual.exposure_stops,
        noise: scans.defects * usual.noise,
        sharpening: scans.sharpening,
        jpeg: ((scans.defects * usual.jpeg.0).min(1.0), usual.jpeg.1),
        ..usual
    };
    let scene = SceneSampler::new(library, synth).scene(seed)?;
    Ok((0..scene.num_views()).map(|view| scene.render(view)).collect())
}

/// Photographs analytic shapes.
pub(super) fn analytic(config: &SourceConfig, seed: u64, random: &mut Random) -> Vec<RenderedView> {
    let kinds = [SceneKind::StillLife, SceneKind::Boxes, SceneKind::HeightField, SceneKind::Torus];
    let options = SceneOptions {
        kind: kinds[(seed % kinds.len() as u64) as usize],
        seed,
        width: config.width,
        height: config.height,
        num_views: config.num_views,
        pair_angle_deg: random.range(6.0, 20.0),
        noise: 0.01,
        ..SceneOptions::default()
    };
    options.render()
}
