//! Everything that is scored about one view whose truth is known: depth, normals of the depth, predicted normals.
//!
//! Invariant: depth shares are of all pixels with a true depth; the figures called `object` look at the pixels of the
//! objects only, and are `None` where there are none.

use crate::depth_map::{DepthMap, restricted_to};
use crate::depth_metrics::{DepthScore, score_depth};
use crate::normal_metrics::{NormalMap, NormalScore, normals_within, score_normals};
use serde::Serialize;
use surfel_core::normals::normals_from_depth;
use surfel_core::{Grid, Intrinsics};

/// What is true of a view, on one raster.
#[derive(Clone, Copy, Debug)]
pub struct TrueMaps<'a> {
    /// Intrinsics in pixels of the maps.
    pub intrinsics: &'a Intrinsics,
    /// z-depth, scene units, 0 = none.
    pub depth: &'a Grid<f32>,
    /// Normals, camera frame.
    pub normals: &'a NormalMap,
    /// True on the objects.
    pub object: &'a Grid<bool>,
}

/// What was predicted of a view. The normals share the raster of the truth.
#[derive(Clone, Copy, Debug)]
pub struct PredictedMaps<'a> {
    /// Intrinsics in pixels of the depth map.
    pub intrinsics: &'a Intrinsics,
    /// z-depth, scene units, 0 = none.
    pub depth: &'a Grid<f32>,
    /// Predicted normals, camera frame, where the method has any.
    pub normals: Option<&'a NormalMap>,
}

/// Scores of one view, or the mean over several.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ViewScore {
    /// Depth of all pixels.
    pub depth: DepthScore,
    /// Depth of the objects' pixels.
    pub object_depth: Option<DepthScore>,
    /// Normals that the predicted depth implies, on the objects.
    pub object_depth_normals: Option<NormalScore>,
    /// Predicted normals, on the objects.
    pub object_normals: Option<NormalScore>,
}

/// Scores a view; `None` when its truth has no depth.
///
/// # Panics
/// If the maps of the truth differ in size, or the predicted normals from them.
pub fn score_view(predicted: PredictedMaps, truth: TrueMaps) -> Option<ViewScore> {
    let depth = DepthMap::new(predicted.depth, predicted.intrinsics);
    let object_depth = restricted_to(truth.depth, truth.object);
    let object_normals = normals_within(truth.normals, truth.object);
    // A normal is a difference of neighbours: it only compares on equal rasters.
    let same_raster = predicted.depth.same_size(truth.depth);
    let implied = same_raster.then(|| normals_from_depth(predicted.depth, predicted.intrinsics));
    Some(ViewScore {
        depth: score_depth(depth, DepthMap::new(truth.depth, truth.intrinsics))?,
        object_depth: score_depth(depth, DepthMap::new(&object_depth, truth.intrinsics)),
        object_depth_normals: implied.and_then(|normals| score_normals(&normals, &object_normals)),
        object_normals: predicted.normals.and_then(|normals| score_normals(normals, &object_normals)),
    })
}

impl ViewScore {
    /// The plain mean over views; `None` for an empty slice.
    pub fn mean(scores: &[Self]) -> Option<Self> {
        let depths: Vec<DepthScore> = scores.iter().map(|s| s.depth).collect();
        let object_depths: Vec<DepthScore> = scores.iter().filter_map(|s| s.object_depth).collect();
        let normals = |field: fn(&Self) -> Option<NormalScore>| {
            NormalScore::mean(&scores.iter().filter_map(field).collect::<Vec<_>>())
        };
        Some(Self {
            depth: DepthScore::mean(&depths)?,
            object_depth: DepthScore::mean(&object_depths),
            object_depth_normals: normals(|s| s.object_depth_normals),
            object_normals: normals(|s| s.object_normals),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_one_millimetre_off_scores_one_millimetre_and_its_normals_none() {
        let k = Intrinsics { fx: 100.0, fy: 100.0, cx: 16.0, cy: 12.0 };
        let (truth, depth) = (Grid::filled(32, 24, 700.0f32), Grid::filled(32, 24, 701.0f32));
        let normals = Grid::filled(32, 24, Some([0.0, 0.0, -1.0]));
        let object = Grid::from_fn(32, 24, |x, _| x < 8);
        let truth = TrueMaps { intrinsics: &k, depth: &truth, normals: &normals, object: &object };
        let turned = Grid::filled(32, 24, Some([0.0, 0.6, -0.8]));
        let score = score_view(PredictedMaps { intrinsics: &k, depth: &depth, normals: Some(&turned) }, truth).unwrap();
        let on_object = score.object_depth.unwrap();
        assert_eq!((score.depth.num_reference, on_object.num_reference), (32 * 24, 8 * 24));
        assert!((on_object.median_abs_error - 1.0).abs() < 1e-9 && score.depth.within_1pct == 1.0);
        // The border of the image has no normals of depth.
        let implied = score.object_depth_normals.unwrap();
        assert!(implied.mean_angle_deg < 1e-4 && (implied.coverage - 7.0 * 22.0 / (8.0 * 24.0)).abs() < 1e-12);
        let predicted = score.object_normals.unwrap();
        assert!((predicted.mean_angle_deg - 0.6f64.asin().to_degrees()).abs() < 1e-4 && predicted.coverage == 1.0);
        let empty = Grid::filled(32, 24, false);
        let nothing = score_view(
            PredictedMaps { intrinsics: &k, depth: &depth, normals: None },
            TrueMaps { object: &empty, ..truth },
        );
        let nothing = nothing.unwrap();
        assert!(nothing.object_depth.is_none() && nothing.object_normals.is_none());
        let mean = ViewScore::mean(&[score, nothing]).unwrap();
        assert_eq!(mean.object_depth, score.object_depth);
    }
}
