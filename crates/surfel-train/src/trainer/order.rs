//! Which sample a step sees, and which pass it teaches.
//!
//! Epochs have an order of their own; only a source whose samples grow harder is seen from its first to its last.
//! Invariant: it follows from the seed and the step alone, so a resumed run sees what the uninterrupted one would have.

use crate::augment::mirrored;
use crate::cache::Cache;
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::sample::Sample;
use surfel_synth::Random;

/// The sample that the run sees as its `number`th; half of all are mirrored.
pub(super) fn draw(train: &[(u64, Cache)], config: &TrainConfig, number: u64) -> Result<Sample, TrainError> {
    let sources: Vec<(u64, bool)> = train.iter().map(|(count, cache)| (*count, cache.grows())).collect();
    let (source, chosen) = choose(&sources, config.seed, number).ok_or(TrainError::EmptyScene)?;
    let sample = train[source].1.sample(chosen)?;
    let mirror = Random::fork(config.seed.wrapping_add(1), number).chance(0.5);
    Ok(if mirror { mirrored(&sample) } else { sample })
}

/// Up to which of its `passes` a network runs in a step: each is taught alone, the last, whose answer counts, twice as
/// often as one before it.
pub(super) fn pass(passes: usize, seed: u64, step: u64) -> usize {
    passes.min(1 + Random::fork(seed.wrapping_add(2), step).below(passes + 1))
}

/// Source and number within it of the `number`th sample of a run; sources are how many samples they have and whether
/// these grow harder.
fn choose(sources: &[(u64, bool)], seed: u64, number: u64) -> Option<(usize, u64)> {
    let total: u64 = sources.iter().map(|(count, _)| count).sum();
    let (epoch, place) = (number.checked_div(total)?, number % total);
    let mut order: Vec<u64> = (0..total).collect();
    let mut random = Random::fork(seed, epoch);
    for i in (1..order.len()).rev() {
        order.swap(i, random.below(i + 1));
    }
    let mut chosen = order[place as usize];
    for (source, (count, grows)) in sources.iter().enumerate() {
        if chosen < *count {
            let in_order = u128::from(*count) * u128::from(place) / u128::from(total);
            return Some((source, if *grows { in_order as u64 } else { chosen }));
        }
        chosen -= count;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_epoch_is_every_sample_once_in_an_order_of_its_own() {
        let sources = [(5, false), (8, false)];
        let epoch = |epoch: u64| (0..13).map(move |n| choose(&sources, 3, 13 * epoch + n).unwrap());
        let whole: Vec<_> = (0..5).map(|n| (0, n)).chain((0..8).map(|n| (1, n))).collect();
        for number in 0..3 {
            let mut seen: Vec<_> = epoch(number).collect();
            assert_ne!(seen, whole);
            seen.sort_unstable();
            assert_eq!(seen, whole);
        }
        assert_ne!(epoch(0).collect::<Vec<_>>(), epoch(1).collect::<Vec<_>>());
        assert_eq!(choose(&[(0, false)], 3, 1), None);
    }

    #[test]
    fn every_pass_is_taught_and_the_last_most() {
        let count = |wanted: usize| (0..4000).filter(|step| pass(3, 7, *step) == wanted).count();
        let [first, second, last] = [1, 2, 3].map(count);
        assert_eq!(first + second + last, 4000);
        assert!(first.abs_diff(1000) < 100 && second.abs_diff(1000) < 100, "{first} {second} {last}");
        assert!((0..20).all(|step| pass(1, 7, step) == 1));
    }

    #[test]
    fn samples_that_grow_harder_are_seen_from_first_to_last() {
        assert!((0..40).all(|number| choose(&[(40, true)], 3, number) == Some((0, number))));
        let of_second: Vec<u64> = (0..100)
            .filter_map(|number| choose(&[(70, false), (30, true)], 3, number))
            .filter_map(|(source, chosen)| (source == 1).then_some(chosen))
            .collect();
        assert!(of_second.len() == 30 && of_second.is_sorted() && of_second[0] < 3 && of_second[29] > 26);
    }
}
