//! Sparse matches between two views: keypoints whose descriptors choose each other.
//!
//! Mutual nearest neighbours that also pass the ratio test (Lowe 2004, section 7.1), by brute force.
//! Everything later in this crate rests on these matches, but no camera is used to find them, so
//! they can testify for or against the cameras. The invariant: same pixels, same matches, same order.

use crate::keypoints::{self, Keypoint};
use crate::{descriptor, pyramid};
use glam::DVec2;
use rayon::prelude::*;
use surfel_core::View;

/// Most keypoints kept per view: enough for every verdict, and 1,500 x 1,500 comparisons stay cheap.
const MAX_KEYPOINTS: usize = 1500;
/// Nearest over second-nearest distance above which a match is a guess.
const MAX_RATIO: f32 = 0.8;
/// A rival nearer than this many pixels to the best is the same corner seen twice, not a rival.
const SAME_CORNER: f64 = 3.0;

/// Length of a descriptor in integers: fine enough for distances, and sums of products stay far below 2^31.
const UNIT: f32 = 8192.0;

/// A point of the scene seen in two views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Continuous pixel in the first view.
    pub a: DVec2,
    /// Continuous pixel in the second view.
    pub b: DVec2,
    /// Confidence in \[0, 1\]: 1 minus the ratio of nearest to second-nearest distance.
    pub score: f64,
}

impl Match {
    /// The same match seen from the other view.
    pub fn swapped(&self) -> Self {
        Self { a: self.b, b: self.a, ..*self }
    }
}

/// The described keypoints of one view.
#[derive(Clone, Debug, Default)]
pub struct Features {
    keypoints: Vec<Keypoint>,
    /// `[num_keypoints, descriptor::LENGTH]`, in steps of 1 / [`UNIT`].
    descriptors: Vec<i16>,
}

impl Features {
    /// Finds and describes the corners of a view, leaving out those near an invalid pixel.
    pub fn of(view: &View) -> Self {
        let octaves = pyramid::octaves(&view.gray());
        let mut found = keypoints::detect(&octaves);
        found.retain(|keypoint| is_clear(view, keypoint));
        let size = (view.image.width(), view.image.height());
        let keypoints = keypoints::oriented(&keypoints::spread(found, size, MAX_KEYPOINTS), &octaves);
        let exact = descriptor::describe(&keypoints, &octaves);
        let descriptors = exact.iter().map(|value| (value * UNIT).round() as i16).collect();
        Self { keypoints, descriptors }
    }

    /// The keypoints, one per described direction.
    pub fn keypoints(&self) -> &[Keypoint] {
        &self.keypoints
    }

    /// Number of described keypoints.
    pub fn len(&self) -> usize {
        self.keypoints.len()
    }

    /// True when the view shows no corner.
    pub fn is_empty(&self) -> bool {
        self.keypoints.is_empty()
    }

    fn descriptor(&self, i: usize) -> &[i16] {
        &self.descriptors[i * descriptor::LENGTH..][..descriptor::LENGTH]
    }
}

/// Matches two views; best first.
pub fn match_views(a: &View, b: &View) -> Vec<Match> {
    let (features_a, features_b) = rayon::join(|| Features::of(a), || Features::of(b));
    match_features(&features_a, &features_b)
}

/// Matches two sets of features; best first, each pair of positions once.
pub fn match_features(a: &Features, b: &Features) -> Vec<Match> {
    if a.is_empty() || b.is_empty() {
        return Vec::new();
    }
    let similarity: Vec<Vec<f32>> = (0..a.len())
        .into_par_iter()
        .map(|i| (0..b.len()).map(|j| dot(a.descriptor(i), b.descriptor(j))).collect())
        .collect();

    let mut best_of_b = vec![(0usize, f32::NEG_INFINITY); b.len()];
    for (i, row) in similarity.iter().enumerate() {
        for (best, &value) in best_of_b.iter_mut().zip(row) {
            if value > best.1 {
                *best = (i, value);
            }
        }
    }

    let mut matches: Vec<Match> = similarity
        .iter()
        .enumerate()
        .filter_map(|(i, row)| {
            let (j, best) = argmax(row)?;
            if best_of_b[j].0 != i {
                return None;
            }
            let position = b.keypoints[j].position;
            let is_rival = |k: &usize| (b.keypoints[*k].position - position).length() > SAME_CORNER;
            let rival = (0..row.len()).filter(is_rival).map(|k| row[k]).fold(-1.0, f32::max);
            let ratio = distance(best) / distance(rival).max(f32::MIN_POSITIVE);
            (ratio < MAX_RATIO).then(|| Match { a: a.keypoints[i].position, b: position, score: 1.0 - ratio as f64 })
        })
        .collect();
    matches.sort_by(|p, q| q.score.total_cmp(&p.score));
    without_twins(matches)
}

/// A corner described in two directions matches twice; keeps the better of the two.
fn without_twins(matches: Vec<Match>) -> Vec<Match> {
    let mut seen = std::collections::HashSet::new();
    let key = |m: &Match| [m.a.x, m.a.y].map(f64::to_bits);
    matches.into_iter().filter(|m| seen.insert(key(m))).collect()
}

fn argmax(row: &[f32]) -> Option<(usize, f32)> {
    row.iter().copied().enumerate().fold(None, |best, (j, value)| match best {
        Some((_, highest)) if value <= highest => best,
        _ => Some((j, value)),
    })
}

/// Euclidean distance of two unit vectors with this dot product.
fn distance(dot: f32) -> f32 {
    (2.0 - 2.0 * dot).max(0.0).sqrt()
}

/// Dot product of two descriptors. Products of 16-bit integers are several times as fast as those of floats, and their
/// sum is exact.
fn dot(a: &[i16], b: &[i16]) -> f32 {
    // Nothing here can overflow; saying so spares the checks that keep the loop from vector instructions.
    let sum = a.iter().zip(b).fold(0i32, |sum, (&a, &b)| sum.wrapping_add(i32::from(a).wrapping_mul(i32::from(b))));
    sum as f32 / (UNIT * UNIT)
}

/// True when the keypoint and a ring of 3 sigma around it lie on valid pixels: the border of a mask
/// or of an undistorted image is no corner of the scene.
fn is_clear(view: &View, keypoint: &Keypoint) -> bool {
    let is_valid = |p: DVec2| {
        let inside = view.camera.contains(p);
        !inside || view.valid[(p.x as usize, p.y as usize)]
    };
    let ring = (0..8).map(|i| DVec2::from_angle(i as f64 * std::f64::consts::FRAC_PI_4) * 3.0 * keypoint.sigma);
    is_valid(keypoint.position) && ring.into_iter().all(|offset| is_valid(keypoint.position + offset))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use surfel_core::{Camera, Grid, Intrinsics, Rigid};

    /// A smooth random texture, seen at an offset.
    fn view(shift: f64) -> View {
        let image = Grid::from_fn(120, 90, |x, y| {
            let (x, y) = (x as f64 + shift, y as f64);
            let waves = (0..12).map(|i| {
                (0.31 * f64::from(i) + x * (0.07 * f64::from(i) + 0.11)).sin() * (y * 0.09 * f64::from(i % 5 + 1)).cos()
            });
            [0.5 + 0.08 * waves.sum::<f64>() as f32; 3]
        });
        let intrinsics = Intrinsics { fx: 100.0, fy: 100.0, cx: 60.0, cy: 45.0 };
        View::new("waves", image, Camera { intrinsics, width: 120, height: 90, camera_from_world: Rigid::IDENTITY })
    }

    /// The slow obvious twin of [`match_features`], in double precision.
    fn match_slowly(a: &Features, b: &Features) -> Vec<(DVec2, DVec2)> {
        let distance = |i: usize, j: usize| {
            let pairs = a.descriptor(i).iter().zip(b.descriptor(j));
            let dot: f64 = pairs.map(|(p, q)| f64::from(*p) * f64::from(*q)).sum();
            (2.0 - 2.0 * dot / f64::from(UNIT * UNIT)).max(0.0).sqrt()
        };
        let nearest = |distances: &[f64]| (0..distances.len()).min_by(|&p, &q| distances[p].total_cmp(&distances[q]));
        let mut found = Vec::new();
        for i in 0..a.len() {
            let to_b: Vec<f64> = (0..b.len()).map(|j| distance(i, j)).collect();
            let Some(j) = nearest(&to_b) else { continue };
            let to_a: Vec<f64> = (0..a.len()).map(|k| distance(k, j)).collect();
            let away = |k: usize| (b.keypoints[k].position - b.keypoints[j].position).length();
            let rival = (0..b.len()).filter(|&k| away(k) > SAME_CORNER).map(|k| to_b[k]).fold(2.0, f64::min);
            if nearest(&to_a) == Some(i) && to_b[j] < f64::from(MAX_RATIO) * rival {
                found.push((a.keypoints[i].position, b.keypoints[j].position));
            }
        }
        found
    }

    #[test]
    fn agrees_with_the_slow_twin() {
        let (a, b) = (Features::of(&view(0.0)), Features::of(&view(7.3)));
        let fast = match_features(&a, &b);
        let slow = match_slowly(&a, &b);
        assert!(fast.len() >= 20, "{}", fast.len());
        assert!(fast.iter().all(|m| slow.contains(&(m.a, m.b))));
        let twins_apart: BTreeSet<[u64; 2]> = slow.iter().map(|(a, _)| [a.x.to_bits(), a.y.to_bits()]).collect();
        assert_eq!(fast.len(), twins_apart.len());
        let shift = |m: &Match| (m.a - m.b - DVec2::new(7.3, 0.0)).length();
        assert!(fast.iter().filter(|m| shift(m) < 0.5).count() * 10 >= 9 * fast.len());
    }

    #[test]
    fn integers_keep_the_descriptors() {
        let view = view(0.0);
        let octaves = pyramid::octaves(&view.gray());
        let keypoints = keypoints::oriented(&keypoints::detect(&octaves), &octaves);
        let exact = descriptor::describe(&keypoints, &octaves);
        for row in exact.chunks(descriptor::LENGTH) {
            let rounded: Vec<i16> = row.iter().map(|value| (value * UNIT).round() as i16).collect();
            let length_sq: f32 = row.iter().map(|value| value * value).sum();
            assert!((length_sq - 1.0).abs() < 1e-5, "{length_sq}");
            assert!((dot(&rounded, &rounded) - 1.0).abs() < 1e-3);
        }
    }
}
