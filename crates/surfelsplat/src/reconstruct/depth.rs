//! Depth of every view by matching: pretrained features, then the plane sweep.
//!
//! Third step of the road, in the working frame. Invariant: estimates and views correspond one to one.

use surfel_core::{Grid, View};
use surfel_features::{FeatureExtractor, FeatureMap, Stage as FeatureStage};
use surfel_stereo::{DepthEstimate, FeatureGrid, MatchConfig, MatchImage, MatchView, estimate_depths, probe_ranges};

/// Stride-4 features of every view: where pretrained features match best without training.
pub fn features_of(views: &[View]) -> Result<Vec<FeatureMap>, surfel_features::WeightsError> {
    let extractor = FeatureExtractor::new()?;
    Ok(views.iter().flat_map(|view| extractor.extract(&view.image, &[FeatureStage::S4])).collect())
}

/// Matches every view against its neighbours; `ranges` are near and far per view in the views' frame.
pub fn match_depths(
    views: &[View],
    features: &[FeatureMap],
    neighbours: &[Vec<usize>],
    ranges: &[(f64, f64)],
    config: &MatchConfig,
) -> Vec<DepthEstimate> {
    let grays: Vec<Grid<f32>> = views.iter().map(View::gray).collect();
    estimate_depths(&match_views(views, &grays, features, ranges), neighbours, config)
}

/// Ranges in which a quick look at thumbnails finds surface, searching a few times farther than `ranges` on
/// either side; `None` where it finds too little to tell.
pub fn probe(
    views: &[View],
    neighbours: &[Vec<usize>],
    ranges: &[(f64, f64)],
    config: &MatchConfig,
) -> Vec<Option<(f64, f64)>> {
    let grays: Vec<Grid<f32>> = views.iter().map(View::gray).collect();
    let wide: Vec<(f64, f64)> = ranges.iter().map(|(near, far)| (near / PROBE_REACH, far * PROBE_REACH)).collect();
    probe_ranges(&match_views(views, &grays, &[], &wide), neighbours, config)
}

/// How many times nearer and farther than the sparse matches the thumbnails are searched.
const PROBE_REACH: f64 = 2.5;

fn match_views<'a>(
    views: &'a [View],
    grays: &'a [Grid<f32>],
    features: &'a [FeatureMap],
    ranges: &[(f64, f64)],
) -> Vec<MatchView<'a>> {
    views
        .iter()
        .enumerate()
        .map(|(v, view)| MatchView {
            image: MatchImage {
                gray: &grays[v],
                valid: &view.valid,
                camera: &view.camera,
                features: features.get(v).map(feature_grid),
            },
            colour: &view.image,
            near: ranges[v].0,
            far: ranges[v].1,
        })
        .collect()
}

fn feature_grid(map: &FeatureMap) -> FeatureGrid<'_> {
    FeatureGrid {
        channels: map.channels,
        width: map.width,
        height: map.height,
        stride: map.stride as f64,
        origin: map.centre_in_input(0) - 0.5,
        data: &map.data,
    }
}
