//! Depth of every view by matching: pretrained features, then the plane sweep.
//!
//! Third step of the road, in the working frame. Invariant: estimates and views correspond one to one.

use surfel_core::{Grid, View};
use surfel_features::{FeatureExtractor, FeatureMap, Stage as FeatureStage};
use surfel_stereo::{DepthEstimate, FeatureGrid, MatchConfig, MatchImage, MatchView, estimate_depths};

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
    let match_views: Vec<MatchView> = views
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
        .collect();
    estimate_depths(&match_views, neighbours, config)
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
