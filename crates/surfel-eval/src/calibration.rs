//! Whether a confidence means what it says: of the pixels with confidence 0.7, seven in ten should be right.
//!
//! Ten equal bins of confidence (a reliability diagram). Rule for missing answers: a pixel without a depth claims
//! nothing and is not counted. Invariant: merging two counts is counting both.

use serde::{Deserialize, Serialize};

/// Bins of confidence between 0 and 1.
pub const NUM_BINS: usize = 10;

/// Pixels of one range of confidence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Bin {
    /// How many.
    pub count: u64,
    /// How many of them are right.
    pub right: u64,
    /// Sum of their confidences.
    pub confidence: f64,
}

impl Bin {
    /// Mean confidence; NaN for an empty bin.
    pub fn mean_confidence(&self) -> f64 {
        self.confidence / self.count as f64
    }

    /// Share that is right; NaN for an empty bin.
    pub fn share_right(&self) -> f64 {
        self.right as f64 / self.count as f64
    }
}

/// Counts of right and wrong answers by confidence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// From no confidence to certainty.
    pub bins: [Bin; NUM_BINS],
}

impl Calibration {
    /// Counts an answer given with a confidence in \[0, 1\].
    pub fn add(&mut self, confidence: f32, right: bool) {
        let bin = &mut self.bins[((confidence * NUM_BINS as f32) as usize).min(NUM_BINS - 1)];
        bin.count += 1;
        bin.right += u64::from(right);
        bin.confidence += f64::from(confidence);
    }

    /// Counts all answers of another count as well.
    pub fn merge(&mut self, other: &Self) {
        for (bin, other) in self.bins.iter_mut().zip(&other.bins) {
            bin.count += other.count;
            bin.right += other.right;
            bin.confidence += other.confidence;
        }
    }

    /// Answers counted.
    pub fn count(&self) -> u64 {
        self.bins.iter().map(|bin| bin.count).sum()
    }

    /// Root mean square difference between mean confidence and share right over the bins, each weighing as many
    /// answers as it holds; `None` without answers.
    pub fn error(&self) -> Option<f64> {
        let count = self.count();
        let square = |bin: &Bin| (bin.right as f64 - bin.confidence).powi(2) / bin.count as f64;
        let sum: f64 = self.bins.iter().filter(|bin| bin.count > 0).map(square).sum();
        (count > 0).then(|| (sum / count as f64).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_honest_confidence_has_no_error_and_a_boast_has_its_size() {
        let (mut honest, mut boast) = (Calibration::default(), Calibration::default());
        for i in 0..100 {
            honest.add(0.75, i % 4 != 0);
            boast.add(1.0, i % 4 != 0);
        }
        assert!(honest.error().unwrap() < 1e-9);
        assert!((boast.error().unwrap() - 0.25).abs() < 1e-9);
        assert_eq!((boast.bins[9].count, boast.bins[9].right), (100, 75));
        assert_eq!(Calibration::default().error(), None);
    }

    #[test]
    fn merging_is_counting_both() {
        let (mut one, mut other, mut both) = (Calibration::default(), Calibration::default(), Calibration::default());
        for i in 0..50 {
            let confidence = i as f32 / 49.0;
            one.add(confidence, i % 2 == 0);
            other.add(1.0 - confidence, i % 3 == 0);
            both.add(confidence, i % 2 == 0);
            both.add(1.0 - confidence, i % 3 == 0);
        }
        one.merge(&other);
        assert_eq!(one.count(), 100);
        assert!((one.error().unwrap() - both.error().unwrap()).abs() < 1e-9);
    }
}
