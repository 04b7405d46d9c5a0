//! Photographs straight to depth: pretrained features, then matching.
//!
//! What the road and the training of the network both do. Invariant: estimates and views correspond one to one.

use crate::config::MatchConfig;
use crate::cost_volume::MatchImage;
use crate::estimate::{DepthEstimate, MatchView, estimate_depths};
use crate::feature_costs::FeatureGrid;
use surfel_core::{Grid, View};
use surfel_features::{FeatureExtractor, FeatureMap, Stage, WeightsError};

/// Stride-4 features of every view: where pretrained features match best without training.
///
/// # Errors
/// When the shipped weights are damaged.
pub fn features_of(views: &[View]) -> Result<Vec<FeatureMap>, WeightsError> {
    let extractor = FeatureExtractor::new()?;
    Ok(views.iter().flat_map(|view| extractor.extract(&view.image, &[Stage::S4])).collect())
}

/// Matches every view against its neighbours; `ranges` are near and far per view in the views' frame.
pub fn match_views(
    views: &[View],
    features: &[FeatureMap],
    neighbours: &[Vec<usize>],
    ranges: &[(f64, f64)],
    config: &MatchConfig,
) -> Vec<DepthEstimate> {
    let grays: Vec<Grid<f32>> = views.iter().map(View::gray).collect();
    estimate_depths(&prepared(views, &grays, features, ranges), neighbours, config)
}

/// Both steps.
///
/// # Errors
/// When the shipped weights are damaged.
pub fn match_photographs(
    views: &[View],
    neighbours: &[Vec<usize>],
    ranges: &[(f64, f64)],
    config: &MatchConfig,
) -> Result<Vec<DepthEstimate>, WeightsError> {
    Ok(match_views(views, &features_of(views)?, neighbours, ranges, config))
}

/// Views as the matcher reads them; without features where there are none.
pub fn prepared<'a>(
    views: &'a [View],
    grays: &'a [Grid<f32>],
    features: &'a [FeatureMap],
    ranges: &[(f64, f64)],
) -> Vec<MatchView<'a>> {
    let views = views.iter().zip(grays).zip(ranges).enumerate();
    views
        .map(|(v, ((view, gray), &(near, far)))| MatchView {
            image: MatchImage {
                gray,
                valid: &view.valid,
                camera: &view.camera,
                features: features.get(v).map(feature_grid),
            },
            colour: &view.image,
            near,
            far,
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
