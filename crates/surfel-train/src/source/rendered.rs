//! Scenes that are rendered for a sample: scanned objects, or analytic shapes.
//!
//! Between the settings of a source and `surfel-synth`. Invariants: settings and seed name the pictures for good, and
//! the pictures that the network is given are the same with and without views held out.

use super::config::{Scans, SourceConfig};
use super::turned;
use surfel_synth::{
    AssetError, AssetLibrary, Random, RenderedView, SceneKind, SceneOptions, SceneSampler, SynthConfig,
};

/// How far beside the outermost cameras a held-out one may stand, in steps from camera to camera.
const BESIDE: f64 = 0.5;

/// Where the cameras of held-out views stand, in steps from the first of the others: between them and beside them.
fn target_places(config: &SourceConfig, seed: u64) -> Vec<f64> {
    // A stream that no camera of a scene draws from.
    let mut random = Random::fork(seed, u64::MAX);
    let last = config.num_views as f64 - 1.0;
    (0..config.num_targets).map(|_| random.range(-BESIDE, last + BESIDE)).collect()
}

/// Photographs scanned objects; held-out views come last.
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
        further_places: target_places(config, seed),
        room_share: scans.room_share,
        street_share: scans.street_share,
        pair_angle_deg: scans.pair_angle_deg,
        exposure_stops: scans.defects * usual.exposure_stops,
        noise: scans.defects * usual.noise,
        sharpening: scans.sharpening,
        jpeg: ((scans.defects * usual.jpeg.0).min(1.0), usual.jpeg.1),
        ..usual
    };
    let scene = SceneSampler::new(library, synth).scene(seed)?;
    let mut views: Vec<RenderedView> = (0..scene.num_views()).map(|view| scene.render(view)).collect();
    let given = views.iter_mut().take(config.num_views);
    turned::turn(given.map(|rendered| &mut rendered.view.camera), scans.turned_px, seed);
    Ok(views)
}

/// Photographs analytic shapes; held-out views come last.
pub(super) fn analytic(config: &SourceConfig, seed: u64, random: &mut Random) -> Vec<RenderedView> {
    let kinds = [SceneKind::StillLife, SceneKind::Boxes, SceneKind::HeightField, SceneKind::Torus];
    let options = SceneOptions {
        kind: kinds[(seed % kinds.len() as u64) as usize],
        seed,
        width: config.width,
        height: config.height,
        num_views: config.num_views,
        pair_angle_deg: random.range(6.0, 20.0),
        further_places: target_places(config, seed),
        noise: 0.01,
        ..SceneOptions::default()
    };
    options.render()
}
