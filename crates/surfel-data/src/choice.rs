//! Which views of a scene make a sample (spec 4.5), for video clips and for sets with scored pairs.
//!
//! The gap between the two contexts of a clip is drawn *between* a smallest and a largest one that both grow with
//! training; drawing the largest from the smallest, as the method's ancestors do, makes the gap a constant. Invariant:
//! contexts and targets are distinct views of the scene, and the same random numbers give the same choice.

use crate::pairs::PairList;
use surfel_synth::Random;

/// Indices of views.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// What the network sees; for a clip in the order of time, for pairs the reference first.
    pub contexts: Vec<usize>,
    /// What it has to predict.
    pub targets: Vec<usize>,
}

/// A whole number that changes linearly with training, then stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ramp {
    /// At step 0.
    pub first: usize,
    /// From step `steps` on.
    pub last: usize,
    /// Length of the change.
    pub steps: usize,
}

impl Ramp {
    /// One value for all of training.
    pub fn constant(value: usize) -> Self {
        Self { first: value, last: value, steps: 0 }
    }

    /// The value at a step, rounded towards the first.
    pub fn at(&self, step: usize) -> usize {
        if step >= self.steps {
            return self.last;
        }
        let (first, last) = (self.first as i128, self.last as i128);
        (first + (last - first) * step as i128 / self.steps as i128) as usize
    }
}

/// Chooses from a clip: the outermost contexts a gap apart, further contexts evenly and targets anywhere between them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GapChooser {
    /// Number of contexts, at least 2.
    pub num_contexts: usize,
    /// Smallest gap.
    pub min_gap: Ramp,
    /// Largest gap.
    pub max_gap: Ramp,
    /// Targets keep this distance from the contexts; with 0 and 1 alike they are never contexts themselves.
    pub margin: usize,
    /// Number of targets.
    pub num_targets: usize,
}

impl GapChooser {
    /// For RealEstate10K and ACID, as the paper's predecessor trains.
    pub fn clips() -> Self {
        let steps = 150_000;
        Self {
            num_contexts: 2,
            min_gap: Ramp { first: 25, last: 45, steps },
            max_gap: Ramp { first: 45, last: 192, steps },
            margin: 0,
            num_targets: 4,
        }
    }

    /// A choice from a clip of `num_views`; `None` when the clip is too short for the smallest gap or its targets.
    pub fn choose(&self, num_views: usize, step: usize, random: &mut Random) -> Option<Choice> {
        let (margin, last) = (self.margin.max(1), self.num_contexts.max(2) - 1);
        // From left + margin to right - margin there are gap - 2 margin + 1 views, some of them contexts.
        let room = self.num_targets + 2 * margin - 1 + (last - 1);
        let smallest = self.min_gap.at(step).max(room).max(1);
        let largest = self.max_gap.at(step).min(num_views.checked_sub(1)?);
        let count = (largest + 1).checked_sub(smallest).filter(|count| *count > 0)?;
        let gap = smallest + random.below(count);
        let left = random.below(num_views - gap);
        let contexts: Vec<usize> = (0..=last).map(|i| left + gap * i / last).collect();
        let between = (left + margin..=left + gap - margin).filter(|view| !contexts.contains(view)).collect();
        let targets = drawn(between, self.num_targets, random);
        Some(Choice { contexts, targets })
    }
}

/// Chooses from scored pairs: a reference with its best sources, targets among the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PairChooser {
    /// Number of contexts, the reference included.
    pub num_contexts: usize,
    /// Number of targets.
    pub num_targets: usize,
    /// Targets are drawn from this many sources after the contexts.
    pub among: usize,
}

impl PairChooser {
    /// For DTU.
    pub fn dtu() -> Self {
        Self { num_contexts: 2, num_targets: 4, among: 8 }
    }

    /// A choice of views below `num_views`; `None` when no reference has enough sources.
    pub fn choose(&self, pairs: &PairList, num_views: usize, random: &mut Random) -> Option<Choice> {
        let num_best = self.num_contexts.checked_sub(1)?;
        let known = |view: usize| view < num_views;
        let sources = |reference: usize| -> Vec<usize> {
            pairs.sources(reference).iter().copied().filter(|&source| known(source) && source != reference).collect()
        };
        let references: Vec<usize> = pairs
            .references()
            .filter(|&reference| known(reference) && sources(reference).len() >= num_best + self.num_targets)
            .collect();
        let reference = *references.get(random.below(references.len()))?;
        let sources = sources(reference);
        let (best, next) = sources.split_at(num_best);
        let next = next[..next.len().min(self.among.max(self.num_targets))].to_vec();
        let contexts = [&[reference], best].concat();
        Some(Choice { contexts, targets: drawn(next, self.num_targets, random) })
    }
}

/// `count` of the values, each at most once.
fn drawn(mut values: Vec<usize>, count: usize, random: &mut Random) -> Vec<usize> {
    for i in 0..count.min(values.len()) {
        let other = i + random.below(values.len() - i);
        values.swap(i, other);
    }
    values.truncate(count);
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    #[test]
    fn a_ramp_goes_either_way_and_stays() {
        let up = Ramp { first: 25, last: 45, steps: 150_000 };
        assert_eq!([0, 7499, 7500, 75_000, 149_999, 150_000, 900_000].map(|t| up.at(t)), [25, 25, 26, 35, 44, 45, 45]);
        let down = Ramp { first: 10, last: 4, steps: 3 };
        assert_eq!([0, 1, 2, 3, 4].map(|t| down.at(t)), [10, 8, 6, 4, 4]);
        assert_eq!(Ramp::constant(7).at(0), 7);
    }

    fn distinct(choice: &Choice) -> bool {
        let all: BTreeSet<usize> = choice.contexts.iter().chain(&choice.targets).copied().collect();
        all.len() == choice.contexts.len() + choice.targets.len()
    }

    proptest! {
        #[test]
        fn a_gap_choice_keeps_every_promise(
            num_views in 0usize..80, least in 0usize..30, more in 0usize..40,
            margin in 0usize..5, num_contexts in 2usize..5, num_targets in 0usize..6, seed in any::<u64>(),
        ) {
            let (min_gap, max_gap) = (Ramp::constant(least), Ramp::constant(least + more));
            let chooser = GapChooser { num_contexts, min_gap, max_gap, margin, num_targets };
            let choice = chooser.choose(num_views, 0, &mut Random::new(seed));
            prop_assert_eq!(&choice, &chooser.choose(num_views, 0, &mut Random::new(seed)));
            let room = num_targets + 2 * margin.max(1) - 1 + (num_contexts - 2);
            let possible = least.max(room).max(1) <= (least + more).min(num_views.saturating_sub(1));
            prop_assert_eq!(choice.is_some(), possible);
            if let Some(choice) = choice {
                prop_assert_eq!(choice.contexts.len(), num_contexts);
                let (left, right) = (choice.contexts[0], choice.contexts[num_contexts - 1]);
                let gaps = choice.contexts.windows(2).map(|pair| pair[1] - pair[0]);
                prop_assert!(gaps.clone().max().unwrap() <= gaps.min().unwrap() + 1);
                prop_assert!(right < num_views && right > left && (least..=least + more).contains(&(right - left)));
                prop_assert_eq!(choice.targets.len(), num_targets);
                prop_assert!(distinct(&choice));
                prop_assert!(choice.targets.iter().all(|t| *t >= left + margin && *t <= right - margin));
            }
        }

        #[test]
        fn a_pair_choice_keeps_every_promise(
            lists in proptest::collection::vec(proptest::collection::vec(0usize..12, 0..12), 0..8),
            num_contexts in 1usize..4, num_targets in 0usize..4, among in 0usize..9, seed in any::<u64>(),
        ) {
            let unique = |list: &Vec<usize>| {
                let mut seen = BTreeSet::new();
                list.iter().copied().filter(|view| seen.insert(*view)).collect::<Vec<_>>()
            };
            let lists: Vec<Vec<usize>> = lists.iter().map(unique).collect();
            let pairs = PairList::new(lists.iter().cloned().enumerate());
            let chooser = PairChooser { num_contexts, num_targets, among };
            let choice = chooser.choose(&pairs, 10, &mut Random::new(seed));
            prop_assert_eq!(&choice, &chooser.choose(&pairs, 10, &mut Random::new(seed)));
            if let Some(choice) = choice {
                prop_assert!(distinct(&choice));
                prop_assert_eq!((choice.contexts.len(), choice.targets.len()), (num_contexts, num_targets));
                prop_assert!(choice.contexts.iter().chain(&choice.targets).all(|view| *view < 10));
                let usable: Vec<usize> =
                    lists[choice.contexts[0]].iter().copied().filter(|s| *s < 10 && *s != choice.contexts[0]).collect();
                prop_assert_eq!(&choice.contexts[1..], &usable[..num_contexts - 1]);
                let allowed = &usable[num_contexts - 1..];
                let allowed = &allowed[..allowed.len().min(among.max(num_targets))];
                prop_assert!(choice.targets.iter().all(|target| allowed.contains(target)));
            }
        }
    }

    /// The mistake this replaces: a gap that never leaves its smallest value.
    #[test]
    fn every_gap_every_place_and_every_target_occurs() {
        let (min_gap, max_gap) = (Ramp::constant(3), Ramp::constant(6));
        let chooser = GapChooser { num_contexts: 2, min_gap, max_gap, margin: 1, num_targets: 2 };
        let mut random = Random::new(5);
        let (mut gaps, mut lefts, mut targets) = ([0; 7], BTreeSet::new(), BTreeSet::new());
        for _ in 0..4000 {
            let choice = chooser.choose(10, 0, &mut random).unwrap();
            gaps[choice.contexts[1] - choice.contexts[0]] += 1;
            lefts.insert(choice.contexts[0]);
            targets.extend(choice.targets);
        }
        assert!(gaps[3..].iter().all(|count| (850..1150).contains(count)), "{gaps:?}");
        assert_eq!(lefts, (0..=6).collect());
        assert_eq!(targets, (1..=8).collect());
    }

    #[test]
    fn the_gap_grows_with_training() {
        let chooser = GapChooser::clips();
        let gaps = |step: usize| -> Vec<usize> {
            let mut random = Random::new(1);
            let mut gap =
                || chooser.choose(300, step, &mut random).map(|choice| choice.contexts[1] - choice.contexts[0]);
            (0..500).filter_map(|_| gap()).collect()
        };
        let (early, late) = (gaps(0), gaps(200_000));
        assert_eq!((early.iter().min(), early.iter().max()), (Some(&25), Some(&45)));
        assert!(late.iter().all(|gap| (45..=192).contains(gap)) && late.iter().any(|gap| *gap > 180));
        assert!(chooser.choose(20, 0, &mut Random::new(1)).is_none());
    }
}
