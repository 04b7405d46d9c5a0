//! Samples made ahead of their use, by several threads.
//!
//! Invariant: they come in the order of their numbers, whoever made them.

use crate::error::TrainError;
use crate::sample::Sample;
use std::ops::Range;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::Scope;

/// Samples that each thread makes ahead.
const AHEAD: usize = 2;

/// The samples `numbers`, one a call, made by `threads` threads that end when this is dropped.
pub(super) fn ahead<'scope>(
    scope: &'scope Scope<'scope, '_>,
    threads: usize,
    numbers: Range<u64>,
    make: impl Fn(u64) -> Result<Sample, TrainError> + Clone + Send + 'scope,
) -> impl FnMut() -> Result<Sample, TrainError> {
    let start = |thread: usize| {
        let (sender, receiver) = sync_channel(AHEAD);
        let (mut numbers, make) = (numbers.clone().skip(thread).step_by(threads), make.clone());
        // Ends with its numbers, after a sample that cannot be made, or when nobody listens any more.
        scope.spawn(move || {
            numbers.all(|number| {
                let sample = make(number);
                let made = sample.is_ok();
                sender.send(sample).is_ok() && made
            })
        });
        receiver
    };
    let makers: Vec<Receiver<_>> = (0..threads).map(start).collect();
    let mut turns = (0..threads).cycle();
    move || {
        let maker = turns.next().and_then(|turn| makers[turn].recv().ok());
        maker.unwrap_or(Err(TrainError::EmptyScene))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::tests::analytic;

    #[test]
    fn samples_come_in_the_order_of_their_numbers_until_one_cannot_be_made() {
        let sample = analytic(1);
        // A sample is told by the far end of its range; the fourth cannot be made.
        let make = |number: u64| {
            let mut sample = sample.clone();
            sample.ranges[0].far = number as f64;
            if number == 8 { Err(TrainError::NoAssets) } else { Ok(sample) }
        };
        for threads in [1, 3] {
            std::thread::scope(|scope| {
                let mut next = ahead(scope, threads, 5..20, &make);
                let far: Vec<f64> = (0..3).map(|_| next().unwrap().ranges[0].far).collect();
                assert_eq!(far, [5.0, 6.0, 7.0]);
                assert!(matches!(next(), Err(TrainError::NoAssets)));
            });
        }
    }
}
