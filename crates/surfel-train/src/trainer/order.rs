//! Which sample a step sees.
//!
//! Invariant: it follows from the seed and the step alone, so a resumed run sees what the uninterrupted one would have.

use crate::augment::mirrored;
use crate::cache::Cache;
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::sample::Sample;
use surfel_synth::Random;

/// The sample that the run sees as its `number`th: epochs in an order of their own, half of them mirrored.
pub(super) fn draw(train: &[(u64, Cache)], config: &TrainConfig, number: u64) -> Result<Sample, TrainError> {
    let total = config.num_samples();
    let (epoch, place) = (number / total, (number % total) as usize);
    let mut order: Vec<u64> = (0..total).collect();
    let mut random = Random::fork(config.seed, epoch);
    for i in (1..order.len()).rev() {
        order.swap(i, random.below(i + 1));
    }
    let mut chosen = order[place];
    for (count, cache) in train {
        if chosen < *count {
            let sample = cache.sample(chosen)?;
            let mirror = Random::fork(config.seed.wrapping_add(1), number).chance(0.5);
            return Ok(if mirror { mirrored(&sample) } else { sample });
        }
        chosen -= count;
    }
    Err(TrainError::EmptyScene)
}
