//! Which views look at each other when there are more than two.
//!
//! Invariant: the choice depends on the poses' proportions only, neither on the unit nor on the order of
//! views that differ.

use surfel_core::Camera;

/// How much a pair looking in opposite directions counts as farther apart than its distance.
const TURN: f64 = 4.0;

/// For each view the `count` closest others (all when there are fewer), closest first; ties by index.
pub fn neighbours(cameras: &[Camera], count: usize) -> Vec<Vec<usize>> {
    // Distances relative to the largest, so that turned but close views are told apart in any unit.
    let centres: Vec<_> = cameras.iter().map(Camera::centre).collect();
    let distance = |i: usize, j: usize| (centres[i] - centres[j]).length();
    let pairs = (0..cameras.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    let largest = pairs.map(|(i, j)| distance(i, j)).fold(f64::MIN_POSITIVE, f64::max);
    let cost = |i: usize, j: usize| {
        let turn = 1.0 - cameras[i].forward().dot(cameras[j].forward());
        distance(i, j) / largest + TURN * turn
    };
    (0..cameras.len())
        .map(|i| {
            let mut others: Vec<usize> = (0..cameras.len()).filter(|&j| j != i).collect();
            others.sort_by(|&a, &b| cost(i, a).total_cmp(&cost(i, b)).then(a.cmp(&b)));
            others.truncate(count);
            others
        })
        .collect()
}
