//! The best candidate of every pixel, with sub-candidate precision and how clearly it won.
//!
//! Reads the aggregated volume; writes inverse depth. Invariant: the result lies within half a candidate
//! of a candidate.

use crate::candidates::Candidates;
use surfel_core::Grid;

/// A chosen inverse depth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Winner {
    /// Inverse depth, 1 / scene units.
    pub inverse_depth: f32,
    /// 0 = another, distant candidate is as good; towards 1 = no rival.
    pub uniqueness: f32,
}

/// Picks the winners from aggregated costs `[height][width][candidates]`.
pub fn winners(width: usize, height: usize, candidates: &Candidates, aggregated: &[i16]) -> Grid<Winner> {
    let n = candidates.count;
    Grid::from_fn(width, height, |x, y| winner(&aggregated[(y * width + x) * n..][..n], candidates))
}

fn winner(costs: &[i16], candidates: &Candidates) -> Winner {
    let best = (0..costs.len()).min_by_key(|&j| costs[j]).unwrap_or(0);
    let cost = f32::from(costs[best]);
    let rival = (0..costs.len()).filter(|&j| j.abs_diff(best) > 2).map(|j| costs[j]).min().map_or(f32::MAX, f32::from);
    let uniqueness = ((rival - cost) / rival.max(1.0)).clamp(0.0, 1.0);
    let index = best as f64 + f64::from(parabola_offset(costs, best));
    Winner { inverse_depth: candidates.inverse_depth(index) as f32, uniqueness }
}

/// Offset in \[-0.5, 0.5\] of the minimum of the parabola through the best cost and its neighbours.
fn parabola_offset(costs: &[i16], best: usize) -> f32 {
    if best == 0 || best + 1 >= costs.len() {
        return 0.0;
    }
    let [left, middle, right] = [costs[best - 1], costs[best], costs[best + 1]].map(f32::from);
    let curvature = left - 2.0 * middle + right;
    if curvature <= 0.0 { 0.0 } else { (0.5 * (left - right) / curvature).clamp(-0.5, 0.5) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_read_to_its_vertex() {
        let candidates = Candidates::uniform(1.0, 4.0, 16);
        let vertex = 6.3;
        let costs: Vec<i16> = (0..16).map(|j| (100.0 * (j as f64 - vertex).powi(2)) as i16).collect();
        let found = winner(&costs, &candidates);
        assert!((f64::from(found.inverse_depth) - candidates.inverse_depth(vertex)).abs() < candidates.step * 0.01);
        assert!(found.uniqueness > 0.5);
    }
}
