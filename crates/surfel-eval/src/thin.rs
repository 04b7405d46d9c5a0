//! Greedy radius thinning: keeps points so that no two are within a radius of each other (spec 7.1 c).
//!
//! Points are taken in a shuffled order; each one still alive is kept and kills all others within the radius.
//! Invariant: the result is exactly that of taking them one by one, though they are decided many at a time: a point
//! is settled as soon as no undecided neighbour comes before it in the order.

use rayon::prelude::*;

/// Indices (ascending) of the points that survive thinning by `radius`, in the order of a shuffle by `seed`.
///
/// Points that are not finite are dropped.
///
/// # Panics
/// If `radius` is not positive, or the points span more than two million radii along an axis.
pub fn thin(points: &[[f32; 3]], radius: f64, seed: u64) -> Vec<u32> {
    assert!(radius > 0.0, "thinning needs a positive radius");
    let cells = Cells::new(points, radius, seed);
    let mut fates = vec![Fate::Undecided; cells.sites.len()];
    let mut undecided: Vec<u32> = (0..cells.sites.len() as u32).collect();
    while !undecided.is_empty() {
        let decided: Vec<Fate> = undecided.par_iter().map(|&i| cells.fate(i, &fates, radius * radius)).collect();
        for (&i, &fate) in undecided.iter().zip(&decided) {
            fates[i as usize] = fate;
        }
        undecided.retain(|&i| fates[i as usize] == Fate::Undecided);
    }
    let mut kept: Vec<u32> =
        cells.sites.iter().zip(&fates).filter(|(_, fate)| **fate == Fate::Kept).map(|(site, _)| site.index).collect();
    kept.par_sort_unstable();
    kept
}

/// The points named by `indices`.
pub fn selected(points: &[[f32; 3]], indices: &[u32]) -> Vec<[f32; 3]> {
    indices.iter().map(|&i| points[i as usize]).collect()
}

/// Place of point `index` in the shuffled order: points are taken from the smallest to the largest.
///
/// The SplitMix64 hash, a bijection, so no two places are equal. Any language reproduces it in a few lines, which
/// lets another implementation of the protocol be compared point by point.
pub fn place_in_order(index: u32, seed: u64) -> u64 {
    let mut z = seed.wrapping_add(u64::from(index)).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

fn distance_sq(a: [f32; 3], b: [f32; 3]) -> f64 {
    (0..3).map(|i| (f64::from(a[i]) - f64::from(b[i])).powi(2)).sum()
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Fate {
    Undecided,
    Kept,
    Killed,
}

struct Site {
    point: [f32; 3],
    index: u32,
    place: u64,
}

const AXIS_BITS: u32 = 21;
const AXIS_MASK: u64 = (1 << AXIS_BITS) - 1;

/// Points sorted by the cube of side `radius` they fall into, `z` fastest: the three cubes along `z` around a
/// point are then one run, so a search visits nine runs instead of 27 cubes.
struct Cells {
    /// Packed cell of each site, ascending.
    keys: Vec<u64>,
    sites: Vec<Site>,
}

impl Cells {
    fn new(points: &[[f32; 3]], side: f64, seed: u64) -> Self {
        let finite = |p: &[f32; 3]| p.iter().all(|c| c.is_finite());
        let low = points
            .iter()
            .filter(|p| finite(p))
            .fold([f64::INFINITY; 3], |low, p| std::array::from_fn(|i| low[i].min(f64::from(p[i]))));
        let key = |p: &[f32; 3]| {
            // From 1, so that a neighbour is never negative.
            let cell: [u64; 3] = std::array::from_fn(|i| ((f64::from(p[i]) - low[i]) / side) as u64 + 1);
            assert!(cell.iter().all(|&c| c < AXIS_MASK), "the points span too many thinning radii");
            pack(cell)
        };
        let indexed = points.par_iter().enumerate().filter(|(_, p)| finite(p));
        let mut order: Vec<(u64, u32)> = indexed.map(|(i, p)| (key(p), i as u32)).collect();
        order.par_sort_unstable();
        let site = |&(_, index): &(u64, u32)| Site {
            point: points[index as usize],
            index,
            place: place_in_order(index, seed),
        };
        Self { sites: order.par_iter().map(site).collect(), keys: order.into_iter().map(|(key, _)| key).collect() }
    }

    /// What the present fates of its neighbours allow to say about site `i`.
    fn fate(&self, i: u32, fates: &[Fate], radius_sq: f64) -> Fate {
        let site = &self.sites[i as usize];
        let key = self.keys[i as usize];
        let [x, y, z] = unpack(key);
        let mut fate = Fate::Kept;
        for column in (x - 1..=x + 1).flat_map(|x| (y - 1..=y + 1).map(move |y| [x, y])) {
            let (first, last) = (pack([column[0], column[1], z - 1]), pack([column[0], column[1], z + 1]));
            let start = self.keys.partition_point(|&key| key < first);
            let end = start + self.keys[start..].iter().take_while(|&&key| key <= last).count();
            for (other, &other_fate) in self.sites[start..end].iter().zip(&fates[start..end]) {
                let before = other.place < site.place && other_fate != Fate::Killed;
                if before && distance_sq(site.point, other.point) <= radius_sq {
                    if other_fate == Fate::Kept {
                        return Fate::Killed;
                    }
                    fate = Fate::Undecided;
                }
            }
        }
        fate
    }
}

fn pack([x, y, z]: [u64; 3]) -> u64 {
    (x << AXIS_BITS | y) << AXIS_BITS | z
}

fn unpack(key: u64) -> [u64; 3] {
    [key >> (2 * AXIS_BITS), key >> AXIS_BITS & AXIS_MASK, key & AXIS_MASK]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The rule as spec 7.1 c states it.
    fn as_stated(points: &[[f32; 3]], radius: f64, seed: u64) -> Vec<u32> {
        let mut alive = vec![true; points.len()];
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        order.sort_by_key(|&i| place_in_order(i, seed));
        for i in order {
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
    fn the_order_depends_on_the_seed_and_has_no_ties() {
        let places = |seed| (0..1000).map(|i| place_in_order(i, seed)).collect::<std::collections::BTreeSet<u64>>();
        assert_eq!(places(7).len(), 1000);
        assert_ne!(place_in_order(0, 7), place_in_order(0, 8));
    }

    #[test]
    fn points_that_are_not_finite_are_dropped() {
        assert_eq!(thin(&[[f32::NAN, 0.0, 0.0], [1.0; 3], [f32::INFINITY; 3]], 0.1, 0), [1]);
    }
}
