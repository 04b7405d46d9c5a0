//! Nearest-neighbour distances from many points to a fixed set.
//!
//! The one place that knows the k-d tree. Invariant: distances come back in the order of the queries, so
//! every statistic over them is the same for any number of threads.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::num::NonZero;

/// A point set prepared for nearest-neighbour queries.
pub struct Nearest {
    tree: Option<ImmutableKdTree<f32, 3>>,
}

impl Nearest {
    /// Indexes the finite points of `points`.
    pub fn new(points: &[[f32; 3]]) -> Self {
        let finite: Vec<[f32; 3]> = points.iter().copied().filter(|p| p.iter().all(|c| c.is_finite())).collect();
        // Construction fails only for an empty set or one beyond 2³² points.
        let tree = if finite.is_empty() { None } else { ImmutableKdTree::new_from_slice(&finite).ok() };
        Self { tree }
    }

    /// Distance from each query to its nearest point if that is at most `limit`, else infinity (also for an empty
    /// set or a query that is not finite).
    ///
    /// The limit is what keeps a query far from every point cheap: without it, half the tree is as good as the rest.
    pub fn distances(&self, queries: &[[f32; 3]], limit: f64) -> Vec<f32> {
        let Some(tree) = &self.tree else {
            return vec![f32::INFINITY; queries.len()];
        };
        // Rounded up, so that squaring in single precision loses no neighbour at the limit itself.
        let limit_sq = (limit * limit * (1.0 + 1e-6)) as f32;
        let distance = |query: &[f32; 3]| {
            if query.iter().any(|c| !c.is_finite()) {
                return f32::INFINITY;
            }
            let nearest = tree.query(query).nearest_n::<SquaredEuclidean<f32>>(NonZero::<usize>::MIN);
            let found = nearest.within::<SquaredEuclidean<f32>>(limit_sq).execute();
            found.first().map_or(f32::INFINITY, |point| point.distance.sqrt())
        };
        queries.par_iter().with_min_len(256).map(distance).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn brute(points: &[[f32; 3]], query: [f32; 3]) -> f32 {
        let sq = |p: &[f32; 3]| (0..3).map(|i| (p[i] - query[i]).powi(2)).sum::<f32>();
        points.iter().map(sq).fold(f32::INFINITY, f32::min).sqrt()
    }

    fn cloud(max: usize) -> impl Strategy<Value = Vec<[f32; 3]>> {
        // Half-integer coordinates make ties, duplicates and collinear sets common.
        proptest::collection::vec(proptest::array::uniform3((-20i32..20).prop_map(|c| c as f32 * 0.5)), 0..max)
    }

    proptest! {
        #[test]
        fn distances_equal_those_of_the_full_search(
            points in cloud(200), queries in cloud(50), limit in prop_oneof![Just(1.5), Just(1e6), 0.1f64..20.0]
        ) {
            let fast = Nearest::new(&points).distances(&queries, limit);
            for (query, distance) in queries.iter().zip(fast) {
                let expected = brute(&points, *query);
                prop_assert_eq!(distance, if f64::from(expected) <= limit { expected } else { f32::INFINITY });
            }
        }
    }

    #[test]
    fn many_copies_of_one_point_and_bad_numbers_are_no_trouble() {
        let mut points = vec![[1.0f32, 2.0, 3.0]; 5000];
        points.push([f32::NAN, 0.0, 0.0]);
        let distances = Nearest::new(&points).distances(&[[1.0, 2.0, 4.0], [f32::INFINITY, 0.0, 0.0]], 9.0);
        assert_eq!(distances, [1.0, f32::INFINITY]);
        assert_eq!(Nearest::new(&[]).distances(&[[0.0; 3]], 9.0), [f32::INFINITY]);
    }
}
