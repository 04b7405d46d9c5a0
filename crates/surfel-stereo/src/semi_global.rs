//! Semi-global aggregation of a cost volume along eight paths (Hirschmüller 2008), edge-aware.
//!
//! Between the raw matching cost and the choice of a depth. Invariant: the result equals the plain
//! recursion (`aggregate_direct` in the tests) exactly, and does not depend on the number of threads.

use crate::config::Smoothness;
use crate::cost_volume::{COST_ONE, CostVolume};
use rayon::prelude::*;
use surfel_core::Grid;

/// Larger than any path cost, small enough to add a penalty without overflow.
const BORDER: i16 = 16_000;

/// Price of a depth jump between two neighbouring pixels.
struct JumpPrice {
    smooth: f32,
    edge: f32,
    half: f32,
}

impl JumpPrice {
    fn new(s: &Smoothness) -> Self {
        let one = f32::from(COST_ONE);
        Self { smooth: s.p2 * one, edge: s.p2_edge * one, half: s.edge }
    }

    fn between(&self, a: f32, b: f32) -> i16 {
        let t = (a - b) / self.half;
        (self.edge + (self.smooth - self.edge) / (1.0 + t * t)) as i16
    }
}

/// Sum over eight paths of the aggregated costs, `[height][width][candidates]`.
pub fn aggregate(volume: &CostVolume, guide: &Grid<f32>, smoothness: &Smoothness) -> Vec<i16> {
    let (width, height, n) = (volume.width, volume.height, volume.candidates.count);
    let price = JumpPrice::new(smoothness);
    let p1 = (smoothness.p1 * f32::from(COST_ONE)) as i16;
    let (mut sum, upward) = rayon::join(
        || vertical(volume, guide, &price, p1, &mut (0..height)),
        || vertical(volume, guide, &price, p1, &mut (0..height).rev()),
    );
    sum.par_chunks_mut(width * n).zip(upward.par_chunks(width * n)).enumerate().for_each_init(
        || (Path::new(n), Path::new(n)),
        |(previous, next), (y, (sum, upward))| {
            sum.iter_mut().zip(upward).for_each(|(s, u)| *s += u);
            let mut along = |xs: &mut dyn Iterator<Item = usize>| {
                let mut before: Option<usize> = None;
                for x in xs {
                    let jump = before.map(|b| price.between(guide[(x, y)], guide[(b, y)]));
                    previous.step(volume.at(x, y), jump, p1, next, &mut sum[x * n..][..n]);
                    std::mem::swap(previous, next);
                    before = Some(x);
                }
            };
            along(&mut (0..width));
            along(&mut (0..width).rev());
        },
    );
    sum
}

/// The three paths that come from the row before, for rows in the given order.
fn vertical(
    volume: &CostVolume,
    guide: &Grid<f32>,
    price: &JumpPrice,
    p1: i16,
    rows: &mut dyn Iterator<Item = usize>,
) -> Vec<i16> {
    let (width, n) = (volume.width, volume.candidates.count);
    let mut sum = vec![0i16; volume.costs.len()];
    let row_of_paths = || (0..width).map(|_| Path::new(n)).collect::<Vec<_>>();
    let mut previous: [Vec<Path>; 3] = std::array::from_fn(|_| row_of_paths());
    let mut next: [Vec<Path>; 3] = std::array::from_fn(|_| row_of_paths());
    let mut before: Option<usize> = None;
    for y in rows {
        for (direction, offset) in [-1isize, 0, 1].into_iter().enumerate() {
            for x in 0..width {
                let from = x as isize + offset;
                let jump = match before {
                    Some(b) if from >= 0 && (from as usize) < width => {
                        Some(price.between(guide[(x, y)], guide[(from as usize, b)]))
                    }
                    _ => None,
                };
                let from = from.clamp(0, width as isize - 1) as usize;
                let sums = &mut sum[(y * width + x) * n..][..n];
                previous[direction][from].step(volume.at(x, y), jump, p1, &mut next[direction][x], sums);
            }
        }
        std::mem::swap(&mut previous, &mut next);
        before = Some(y);
    }
    sum
}

/// Path costs of one pixel, with a border on either side so that the inner loop has no branch.
#[derive(Clone)]
struct Path {
    costs: Vec<i16>,
    smallest: i16,
}

impl Path {
    fn new(count: usize) -> Self {
        Self { costs: vec![BORDER; count + 2], smallest: 0 }
    }

    /// `next = cost + min(stay, ±1 + p1, anywhere + jump) - smallest`, added to `sum`; a path that starts
    /// here (`jump` is `None`) is the cost itself.
    fn step(&self, cost: &[i16], jump: Option<i16>, p1: i16, next: &mut Self, sum: &mut [i16]) {
        let n = cost.len();
        let out = &mut next.costs[1..=n];
        let mut smallest = i16::MAX;
        if let Some(jump) = jump {
            let anywhere = self.smallest + jump;
            let (below, same, above) = (&self.costs[..n], &self.costs[1..=n], &self.costs[2..n + 2]);
            for d in 0..n {
                let step = below[d].min(above[d]) + p1;
                let value = cost[d] + same[d].min(step).min(anywhere) - self.smallest;
                out[d] = value;
                smallest = smallest.min(value);
            }
        } else {
            out.copy_from_slice(cost);
            smallest = cost.iter().copied().min().unwrap_or(0);
        }
        next.smallest = smallest;
        for (sum, value) in sum.iter_mut().zip(out.iter()) {
            *sum += value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::candidates::Candidates;

    /// The recursion as written in the paper, one path after the other.
    fn aggregate_direct(volume: &CostVolume, guide: &Grid<f32>, smoothness: &Smoothness) -> Vec<i32> {
        let (w, h, n) = (volume.width as isize, volume.height as isize, volume.candidates.count);
        let price = JumpPrice::new(smoothness);
        let p1 = (smoothness.p1 * f32::from(COST_ONE)) as i32;
        let mut sum = vec![0i32; volume.costs.len()];
        let directions = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)];
        for (dx, dy) in directions {
            let mut path = vec![0i32; volume.costs.len()];
            let xs: Vec<isize> = if dx >= 0 { (0..w).collect() } else { (0..w).rev().collect() };
            let ys: Vec<isize> = if dy >= 0 { (0..h).collect() } else { (0..h).rev().collect() };
            for &y in &ys {
                for &x in &xs {
                    let (px, py) = (x - dx, y - dy);
                    let inside = px >= 0 && py >= 0 && px < w && py < h;
                    for d in 0..n {
                        let cost = i32::from(volume.at(x as usize, y as usize)[d]);
                        let value = if inside {
                            let before = &path[(py * w + px) as usize * n..][..n];
                            let least = *before.iter().min().unwrap();
                            let jump =
                                price.between(guide[(x as usize, y as usize)], guide[(px as usize, py as usize)]);
                            let mut best = before[d].min(least + i32::from(jump));
                            if d > 0 {
                                best = best.min(before[d - 1] + p1);
                            }
                            if d + 1 < n {
                                best = best.min(before[d + 1] + p1);
                            }
                            cost + best - least
                        } else {
                            cost
                        };
                        path[(y * w + x) as usize * n + d] = value;
                        sum[(y * w + x) as usize * n + d] += value;
                    }
                }
            }
        }
        sum
    }

    #[test]
    fn equals_the_plain_recursion() {
        let (width, height, count) = (13, 9, 11);
        let costs = (0..width * height * count).map(|i| ((i * 7919 + 13) % 1000) as i16).collect();
        let volume = CostVolume { width, height, candidates: Candidates::uniform(1.0, 4.0, count), costs };
        let guide = Grid::from_fn(width, height, |x, y| ((x * 31 + y * 17) % 10) as f32 / 10.0);
        let smoothness = Smoothness::default();
        let fast: Vec<i32> = aggregate(&volume, &guide, &smoothness).into_iter().map(i32::from).collect();
        assert_eq!(fast, aggregate_direct(&volume, &guide, &smoothness));
    }
}
