//! The best candidate of every pixel, with sub-candidate precision and how clearly it won.
//!
//! Reads the aggregated volume; writes inverse depth. Invariant: the result lies within half a candidate
//! of a candidate.

use crate::candidates::Candidates;

/// A chosen inverse depth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Winner {
    /// Inverse depth, 1 / scene units.
    pub inverse_depth: f32,
    /// 0 = another, distant candidate is as good; towards 1 = no rival.
    pub uniqueness: f32,
}

/// The winner among the aggregated costs of a pixel.
pub fn winner(costs: &[i16], candidates: &Candidates) -> Winner {
    let smallest = |costs: &[i16]| costs.iter().fold(i16::MAX, |least, &cost| least.min(cost));
    let cost = smallest(costs);
    let best = costs.iter().position(|&c| c == cost).unwrap_or(0);
    let rival = smallest(&costs[..best.saturating_sub(2)]).min(smallest(costs.get(best + 3..).unwrap_or(&[])));
    let (cost, rival) = (f32::from(cost), f32::from(rival));
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
