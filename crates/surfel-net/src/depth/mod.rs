//! Depth: a coarse distribution over a cost volume at stride 4, then refinement to full resolution; or, in a
//! seeded network, the refinement of what matching found.
//!
//! Inside the network, depth is *relative disparity* in \[0, 1\]: 0 at the far end of the view's range, 1 at
//! the near end. Invariant: nothing here depends on the scene unit.

mod choice;
mod coarse;
mod cross_view;
mod features;
mod likeness;
mod passes;
mod patches;
mod refine;
mod scorer;
mod seed_maps;
mod seeded;

pub use choice::Choice;
pub(crate) use coarse::CoarseDepth;
pub(crate) use features::Features;
pub(crate) use passes::{Given, refined_in_passes};
pub(crate) use refine::{Refined, Refinement, SceneGeometry};
pub(crate) use seeded::SeededRefinement;

use crate::cost_volume::DepthRange;
use burn::tensor::{Device, Tensor, TensorData};

/// One value per view, `[views, 1, 1, 1]`.
pub(crate) fn per_view(ranges: &[DepthRange], value: impl Fn(&DepthRange) -> f64, device: &Device) -> Tensor<4> {
    let values: Vec<f32> = ranges.iter().map(|range| value(range) as f32).collect();
    Tensor::from_data(TensorData::new(values, [ranges.len(), 1, 1, 1]), device)
}

/// Disparity in 1 / scene units of relative disparity.
pub(crate) fn disparity(relative: Tensor<4>, ranges: &[DepthRange]) -> Tensor<4> {
    let device = relative.device();
    relative * per_view(ranges, DepthRange::disparity_span, &device)
        + per_view(ranges, DepthRange::far_disparity, &device)
}
