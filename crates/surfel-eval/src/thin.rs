//! Greedy radius thinning: keeps points so that no two are within a radius of each other (spec 7.1 c).
//!
//! Points are taken in a shuffled order; each one still alive is kept and kills all others within the radius.
//! Invariant: kept points are more than the radius apart, and every killed one is within it of a kept one.

use rayon::prelude::*;
use std::collections::HashMap;

/// Indices (ascending) of the points that survive thinning by `radius`, shuffled by `seed`.
///
/// Points that are not finite are dropped.
///
/// # Panics
/// If `radius` is not positive, or the points span more than two million radii along an axis.
pub fn thin(points: &[[f32; 3]], radius: f64, seed: u64) -> Vec<u32> {
    assert!(radius > 0.0, "thinning needs a positive radius");
    let cells = Cells::new(points, radius);
    let mut alive = vec![false; points.len()];
    for &(_, index) in &cells.sorted {
        alive[index as usize] = true;
    }
    let radius_sq = radius * radius;
    for index in shuffled(points.len(), seed) {
        if !alive[index as usize] {
            continue;
        }
        let point = points[index as usize];
        cells.for_each_near(point, |other| {
            if other != index && distance_sq(point, points[other as usize]) <= radius_sq {
                alive[other as usize] = false;
            }
        });
    }
    (0..points.len() as u32).filter(|&i| alive[i as usize]).collect()
}

/// The points named by ascending `indices`.
pub fn selected(points: &[[f32; 3]], indices: &[u32]) -> Vec<[f32; 3]> {
    indices.iter().map(|&i| points[i as usize]).collect()
}

/// A permutation of `0..count`: indices sorted by the SplitMix64 hash of `seed + index`.
///
/// Any language reproduces it in one line, which is what lets another implementation of the protocol be
/// compared point by point.
pub fn shuffled(count: usize, seed: u64) -> Vec<u32> {
    let mut order: Vec<(u64, u32)> =
        (0..count as u32).into_par_iter().map(|i| (split_mix(seed.wrapping_add(u64::from(i))), i)).collect();
    order.par_sort_unstable();
    order.into_iter().map(|(_, i)| i).collect()
}

fn split_mix(state: u64) -> u64 {
    let mut z = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

fn distance_sq(a: [f32; 3], b: [f32; 3]) -> f64 {
    (0..3).map(|i| (f64::from(a[i]) - f64::from(b[i])).powi(2)).sum()
}

const AXIS_BITS: u32 = 21;
const AXIS_MASK: u64 = (1 << AXIS_BITS) - 1;

/// Points sorted by the cube of side `radius` they fall into, `z` fastest: the three cubes along `z` around a
/// point are then one run, so a search visits nine runs instead of 27 cubes.
struct Cells {
    /// `(packed cell, point index)`, ascending.
    sorted: Vec<(u64, u32)>,
    /// Start and end in `sorted` of each `(x, y)` column.
    columns: HashMap<u64, (u32, u32)>,
    low: [f64; 3],
    side: f64,
}

impl Cells {
    fn new(points: &[[f32; 3]], side: f64) -> Self {
        let finite = |p: &[f32; 3]| p.iter().all(|c| c.is_finite());
        let low = points.iter().filter(|p| finite(p)).fold([f64::INFINITY; 3], |low, p| {
            std::array::from_fn(|i| low[i].min(f64::from(p[i])))
        });
        let mut cells = Self { sorted: Vec::new(), columns: HashMap::new(), low, side };
        cells.sorted = points
            .par_iter()
            .enumerate()
            .filter(|(_, p)| finite(p))
            .map(|(i, p)| {
                let [x, y, z] = cells.cell_of(*p);
                (pack(x, y) << AXIS_BITS | z, i as u32)
            })
            .collect();
        cells.sorted.par_sort_unstable();
        let mut start = 0;
        for run in cells.sorted.chunk_by(|a, b| a.0 >> AXIS_BITS == b.0 >> AXIS_BITS) {
            let end = start + run.len() as u32;
            cells.columns.insert(run[0].0 >> AXIS_BITS, (start, end));
            start = end;
        }
        cells
    }

    /// Cell coordinates, from 1 so that a neighbour is never negative.
    fn cell_of(&self, point: [f32; 3]) -> [u64; 3] {
        std::array::from_fn(|i| {
            let cell = ((f64::from(point[i]) - self.low[i]) / self.side) as u64 + 1;
            assert!(cell < AXIS_MASK, "the points span too many thinning radii");
            cell
        })
    }

    fn for_each_near(&self, point: [f32; 3], mut visit: impl FnMut(u32)) {
        let [x, y, z] = self.cell_of(point);
        for column in (x - 1..=x + 1).flat_map(|x| (y - 1..=y + 1).map(move |y| pack(x, y))) {
            let Some(&(start, end)) = self.columns.get(&column) else { continue };
            let run = &self.sorted[start as usize..end as usize];
            let first = run.partition_point(|(cell, _)| cell & AXIS_MASK < z - 1);
            run[first..].iter().take_while(|(cell, _)| cell & AXIS_MASK <= z + 1).for_each(|&(_, i)| visit(i));
        }
    }
}

fn pack(x: u64, y: u64) -> u64 {
    x << AXIS_BITS | y
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The rule as spec 7.1 c states it.
    fn as_stated(points: &[[f32; 3]], radius: f64, seed: u64) -> Vec<u32> {
        let mut alive = vec![true; points.len()];
        for i in shuffled(points.len(), seed) {
            if alive[i as usize] {
                for j in 0..points.len() {
                    if j != i as usize && distance_sq(points[i as usize], points[j]) <= radius * radius {
                        alive[j] = false;
                    }
                }
            }
        }
        (0..points.len() as u32).filter(|&i| alive[i as usize]).collect()
    }

    proptest! {
        #[test]
        fn the_grid_thins_as_the_full_search_does(
            // Quarter steps put many pairs at exactly the radius and many points on top of each other.
            points in proptest::collection::vec(proptest::array::uniform3((-12i32..12).prop_map(|c| c as f32 * 0.25)), 0..300),
            radius in prop_oneof![Just(0.5), Just(0.25), 0.1f64..2.0],
            seed in any::<u64>(),
        ) {
            prop_assert_eq!(thin(&points, radius, seed), as_stated(&points, radius, seed));
        }
    }

    #[test]
    fn shuffling_is_a_permutation_and_depends_on_the_seed() {
        let mut order = shuffled(1000, 7);
        assert_ne!(order, shuffled(1000, 8));
        order.sort_unstable();
        assert!(order.iter().enumerate().all(|(i, &o)| i as u32 == o));
    }

    #[test]
    fn points_that_are_not_finite_are_dropped() {
        assert_eq!(thin(&[[f32::NAN, 0.0, 0.0], [1.0; 3], [f32::INFINITY; 3]], 0.1, 0), [1]);
    }
}
