//! How many matches agree with *some* rigid scene, whatever the given cameras say.
//!
//! A fundamental matrix fitted to the matches alone by random sampling (Fischler and Bolles 1981;
//! eight-point algorithm, Hartley 1997). It is the witness that tells wrong cameras from wrong
//! matches. The invariant: the sampling is seeded by a constant, so verdicts never waver.

use crate::{EpipolarGeometry, Match};
use glam::{DMat3, DVec2, DVec3};

/// Finds a clean sample with probability 0.98 when half of the matches are wrong.
const NUM_SAMPLES: usize = 1000;
const SAMPLE_SIZE: usize = 8;
/// Eight matches always agree, and a search over many samples wins some more by luck.
const MIN_INLIERS: usize = 20;
const MIN_INLIER_SHARE: f64 = 0.35;

/// The largest set of matches found that one rigid geometry explains.
#[derive(Clone, Debug, PartialEq)]
pub struct Consensus {
    /// The fitted geometry.
    pub geometry: EpipolarGeometry,
    /// Indices of the agreeing matches, ascending.
    pub inliers: Vec<usize>,
}

/// Fits a rigid geometry to matches sorted best first; `None` when even the best fit explains hardly
/// more than chance would: fewer than `MIN_INLIERS` matches, or under 35 % of them.
pub fn consensus(matches: &[Match], inlier_distance: f64) -> Option<Consensus> {
    if matches.len() < MIN_INLIERS {
        return None;
    }
    let frame_a = Normalisation::of(matches.iter().map(|m| m.a));
    let frame_b = Normalisation::of(matches.iter().map(|m| m.b));
    let pairs: Vec<(DVec2, DVec2)> = matches.iter().map(|m| (frame_a.apply(m.a), frame_b.apply(m.b))).collect();
    let geometry_of = |members: &[usize]| {
        let normalised = fundamental(members.iter().map(|&i| pairs[i]))?;
        let fundamental = frame_b.matrix().transpose() * normalised * frame_a.matrix();
        Some(EpipolarGeometry { fundamental })
    };
    let inliers_of = |geometry: &EpipolarGeometry| -> Vec<usize> {
        (0..matches.len()).filter(|&i| geometry.distance(&matches[i]) < inlier_distance).collect()
    };

    let mut random = SplitMix(0x5eed);
    let mut best: Option<Consensus> = None;
    for sample in 0..NUM_SAMPLES {
        // The pool grows from the surest matches to all of them (Chum and Matas 2005).
        let pool = (matches.len() * (sample + 1) / NUM_SAMPLES).clamp(MIN_INLIERS, matches.len());
        let Some(geometry) = geometry_of(&random.distinct(SAMPLE_SIZE, pool)) else { continue };
        let inliers = inliers_of(&geometry);
        if best.as_ref().is_none_or(|best| inliers.len() > best.inliers.len()) {
            best = Some(refitted(Consensus { geometry, inliers }, &geometry_of, &inliers_of));
        }
    }
    best.filter(|best| {
        best.inliers.len() >= MIN_INLIERS && best.inliers.len() as f64 >= MIN_INLIER_SHARE * matches.len() as f64
    })
}

/// Refits to all inliers as long as that finds more.
fn refitted(
    start: Consensus,
    geometry_of: &impl Fn(&[usize]) -> Option<EpipolarGeometry>,
    inliers_of: &impl Fn(&EpipolarGeometry) -> Vec<usize>,
) -> Consensus {
    let mut best = start;
    while best.inliers.len() >= SAMPLE_SIZE {
        let Some(geometry) = geometry_of(&best.inliers) else { break };
        let inliers = inliers_of(&geometry);
        if inliers.len() <= best.inliers.len() {
            break;
        }
        best = Consensus { geometry, inliers };
    }
    best
}

/// Moves points to mean 0 and mean distance sqrt 2, without which the eight-point algorithm drowns in rounding.
struct Normalisation {
    centre: DVec2,
    scale: f64,
}

impl Normalisation {
    fn of(points: impl Iterator<Item = DVec2> + Clone) -> Self {
        let count = points.clone().count().max(1) as f64;
        let centre = points.clone().sum::<DVec2>() / count;
        let spread = points.map(|p| (p - centre).length()).sum::<f64>() / count;
        Self { centre, scale: std::f64::consts::SQRT_2 / spread.max(f64::MIN_POSITIVE) }
    }

    fn apply(&self, point: DVec2) -> DVec2 {
        (point - self.centre) * self.scale
    }

    fn matrix(&self) -> DMat3 {
        DMat3::from_cols(DVec3::X * self.scale, DVec3::Y * self.scale, (-self.centre * self.scale).extend(1.0))
    }
}

/// Least-squares `F` with `b^T F a = 0` and unit norm. The rank is left alone: only distances to lines
/// are read from it.
fn fundamental(pairs: impl Iterator<Item = (DVec2, DVec2)>) -> Option<DMat3> {
    let mut normal = [[0.0; 9]; 9];
    for (a, b) in pairs {
        let row = [b.x * a.x, b.x * a.y, b.x, b.y * a.x, b.y * a.y, b.y, a.x, a.y, 1.0];
        for i in 0..9 {
            for j in 0..9 {
                normal[i][j] += row[i] * row[j];
            }
        }
    }
    smallest_eigenvector(normal).map(|f| DMat3::from_cols_array(&f).transpose())
}

/// Inverse iteration on a symmetric positive semi-definite matrix, shifted a little to be invertible.
fn smallest_eigenvector(mut matrix: [[f64; 9]; 9]) -> Option<[f64; 9]> {
    let trace: f64 = (0..9).map(|i| matrix[i][i]).sum();
    (0..9).for_each(|i| matrix[i][i] += 1e-13 * trace);
    let lower = cholesky(&matrix)?;
    let mut vector = [1.0 / 3.0; 9];
    for _ in 0..4 {
        for i in 0..9 {
            let known: f64 = (0..i).map(|j| lower[i][j] * vector[j]).sum();
            vector[i] = (vector[i] - known) / lower[i][i];
        }
        for i in (0..9).rev() {
            let known: f64 = (i + 1..9).map(|j| lower[j][i] * vector[j]).sum();
            vector[i] = (vector[i] - known) / lower[i][i];
        }
        let length = vector.iter().map(|v| v * v).sum::<f64>().sqrt();
        vector.iter_mut().for_each(|v| *v /= length);
    }
    vector.iter().all(|v| v.is_finite()).then_some(vector)
}

fn cholesky(matrix: &[[f64; 9]; 9]) -> Option<[[f64; 9]; 9]> {
    let mut lower = [[0.0; 9]; 9];
    for i in 0..9 {
        for j in 0..=i {
            let known: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let rest = matrix[i][j] - known;
            match i == j {
                true if rest <= 0.0 => return None,
                true => lower[i][i] = rest.sqrt(),
                false => lower[i][j] = rest / lower[j][j],
            }
        }
    }
    Some(lower)
}

/// Steele, Lea and Flood 2014; three lines instead of a dependency whose stream changes with its version.
struct SplitMix(u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// `count` different numbers below `below`, which must not be smaller than `count`.
    fn distinct(&mut self, count: usize, below: usize) -> Vec<usize> {
        let mut chosen = Vec::with_capacity(count);
        while chosen.len() < count {
            let candidate = (self.next() % below as u64) as usize;
            if !chosen.contains(&candidate) {
                chosen.push(candidate);
            }
        }
        chosen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scattered(count: usize) -> Vec<DVec2> {
        let mut random = SplitMix(7);
        let mut unit = move || (random.next() >> 11) as f64 / (1u64 << 53) as f64;
        (0..count).map(|_| DVec2::new(480.0 * unit(), 360.0 * unit())).collect()
    }

    #[test]
    fn finds_the_rigid_matches_among_as_many_wrong_ones() {
        let (from, depths, stray) = (scattered(120), scattered(240), scattered(360));
        let matches: Vec<Match> = (0..120)
            .map(|i| {
                let shift = DVec2::new(10.0 + depths[120 + i].x / 10.0, 0.02 * from[i].x);
                let b = if i % 2 == 0 { from[i] + shift } else { stray[240 + i] };
                Match { a: from[i], b, score: 0.5 }
            })
            .collect();
        let found = consensus(&matches, 1.0).expect("half of the matches are rigid");
        let good = found.inliers.iter().filter(|&&i| i % 2 == 0).count();
        assert!(good >= 55, "{good} of 60");
        assert!(found.inliers.len() - good <= 6, "{} strays", found.inliers.len() - good);
    }

    #[test]
    fn random_matches_have_no_consensus() {
        let (from, to) = (scattered(80), scattered(200));
        let matches: Vec<Match> = (0..80).map(|i| Match { a: from[i], b: to[i + 110], score: 0.5 }).collect();
        assert_eq!(consensus(&matches, 2.0), None);
    }
}
