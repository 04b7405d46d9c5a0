//! Every number of the matching, in one place, in pixels or shares: none has a scene unit.

/// Weights and windows of the matching cost.
#[derive(Clone, Debug, PartialEq)]
pub struct CostWeights {
    /// Weight of ZNCC over the small window.
    pub small: f32,
    /// Radius of the small window, pixels.
    pub small_radius: usize,
    /// Weight of ZNCC over the wide window.
    pub wide: f32,
    /// Radius of the wide window, pixels.
    pub wide_radius: usize,
    /// Weight of the feature distance, used when features are given.
    pub features: f32,
}

impl Default for CostWeights {
    fn default() -> Self {
        Self { small: 1.0, small_radius: 1, wide: 0.6, wide_radius: 3, features: 0.8 }
    }
}

/// Smoothness of the semi-global aggregation, as shares of the cost of a certain mismatch.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoothness {
    /// Price of a change by one candidate.
    pub p1: f32,
    /// Price of a jump across an edge-free pixel pair.
    pub p2: f32,
    /// Price of a jump across a strong image edge.
    pub p2_edge: f32,
    /// Luma difference at which the price has fallen halfway.
    pub edge: f32,
}

impl Default for Smoothness {
    fn default() -> Self {
        Self { p1: 0.06, p2: 0.9, p2_edge: 0.2, edge: 0.06 }
    }
}

/// The slanted refinement.
#[derive(Clone, Debug, PartialEq)]
pub struct Refinement {
    /// Rounds of photometric correction and plane fitting.
    pub rounds: usize,
    /// Rounds at every finer size after an upsampling.
    pub finer_rounds: usize,
    /// Radius of the photometric window, pixels.
    pub window_radius: usize,
    /// Luma difference at which a window pixel's weight has halved.
    pub window_edge: f32,
    /// Distance of a window pixel from the plane, source pixels, at which its weight has halved.
    pub window_agree_px: f32,
    /// Radius of the plane fit, pixels.
    pub fit_radius: usize,
    /// How many times `fit_radius` the sparse outer rings of the plane fit reach.
    pub fit_reach: usize,
    /// How many times wider (in area) the plane fit averages where evidence is weakest.
    pub fit_widening: f32,
    /// Luma difference at which a neighbour's weight in the plane fit has fallen to 1/e.
    pub fit_edge: f32,
}

impl Default for Refinement {
    fn default() -> Self {
        Self {
            rounds: 3,
            finer_rounds: 3,
            window_radius: 3,
            window_edge: 0.06,
            window_agree_px: 0.5,
            fit_radius: 8,
            fit_reach: 4,
            fit_widening: 16.0,
            fit_edge: 0.12,
        }
    }
}

/// All of the matching.
#[derive(Clone, Debug, PartialEq)]
pub struct MatchConfig {
    /// Largest step between candidates, pixels in a source view.
    pub step_px: f64,
    /// Photographs with more pixels are swept at half their size (repeatedly) and refined upwards.
    pub max_sweep_pixels: usize,
    /// Matching cost.
    pub cost: CostWeights,
    /// Aggregation.
    pub smoothness: Smoothness,
    /// Refinement.
    pub refinement: Refinement,
    /// Left-right disagreement at which confidence has fallen to 1/e, pixels.
    pub consistency_px: f32,
}

impl Default for MatchConfig {
    fn default() -> Self {
        Self {
            step_px: 1.0,
            max_sweep_pixels: 120_000,
            cost: CostWeights::default(),
            smoothness: Smoothness::default(),
            refinement: Refinement::default(),
            consistency_px: 1.0,
        }
    }
}
