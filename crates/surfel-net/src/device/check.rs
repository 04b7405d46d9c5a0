//! Every kind of operator on a device against the CPU: how far apart, and how long each takes.
//!
//! Invariant: both devices get the same numbers and answer the same question; only where it is computed differs.

use super::cases::{Case, cases};
use burn::tensor::Device;
use std::time::Instant;

/// One operator, forward and backward.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// What was computed.
    pub name: &'static str,
    /// Largest difference of outputs and gradients, relative to the largest value on the CPU.
    pub difference: f64,
    /// The difference up to which the device counts as right.
    pub tolerance: f64,
    /// Milliseconds on the device: the best of several runs, results fetched.
    pub device_ms: f64,
    /// Milliseconds on the CPU.
    pub cpu_ms: f64,
}

impl Check {
    /// True when the device answers as the CPU does.
    pub fn holds(&self) -> bool {
        // A difference that is not a number must not pass.
        self.difference <= self.tolerance
    }
}

/// Compares `device` with the CPU for two photographs of `width` x `height` pixels (multiples of 16) and times both,
/// `runs` times each after one that is not counted; calls `done` after each operator.
pub fn check(
    device: &Device,
    (width, height): (usize, usize),
    runs: usize,
    mut done: impl FnMut(&Check),
) -> Vec<Check> {
    let cpu = Device::flex();
    let compare = |case: Case| {
        let (expected, cpu_ms) = timed(&case, &cpu, runs);
        let (found, device_ms) = timed(&case, device, runs);
        let differences = expected.iter().zip(&found).map(|(expected, found)| relative_difference(expected, found));
        // `f64::max` would lose a difference that is not a number.
        let difference =
            differences.fold(0.0, |most: f64, next| if next > most || next.is_nan() { next } else { most });
        let check = Check { name: case.name, difference, tolerance: case.tolerance, device_ms, cpu_ms };
        done(&check);
        check
    };
    cases(width, height).into_iter().map(compare).collect()
}

/// The answer of a case on a device, and milliseconds of the fastest run.
fn timed(case: &Case, device: &Device, runs: usize) -> (Vec<Vec<f32>>, f64) {
    let answer = (case.compute)(device);
    let run = |_| {
        let start = Instant::now();
        std::hint::black_box((case.compute)(device));
        start.elapsed().as_secs_f64() * 1e3
    };
    (answer, (0..runs.max(1)).map(run).fold(f64::INFINITY, f64::min))
}

/// Largest difference over largest expected value; not a number where one of them is none.
fn relative_difference(expected: &[f32], found: &[f32]) -> f64 {
    if expected.len() != found.len() || expected.iter().chain(found).any(|value| !value.is_finite()) {
        return f64::NAN;
    }
    let largest = expected.iter().map(|value| f64::from(value.abs())).fold(f64::MIN_POSITIVE, f64::max);
    let differences = expected.iter().zip(found).map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs());
    differences.fold(0.0, f64::max) / largest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cpu_agrees_with_itself_on_every_case() {
        let mut told = 0;
        let checks = check(&Device::flex(), (64, 48), 1, |_| told += 1);
        assert_eq!(told, checks.len());
        for check in checks {
            assert!(check.holds() && check.difference == 0.0, "{check:?}");
        }
    }

    #[test]
    fn a_wrong_or_broken_answer_does_not_hold() {
        let check = |found: &[f32]| {
            let difference = relative_difference(&[1.0, -4.0], found);
            Check { name: "case", difference, tolerance: 1e-3, device_ms: 1.0, cpu_ms: 1.0 }
        };
        assert!(check(&[1.0, -4.0]).holds() && check(&[1.003, -4.0]).holds());
        assert!(!check(&[1.01, -4.0]).holds());
        assert!(!check(&[f32::NAN, -4.0]).holds() && !check(&[1.0]).holds());
    }
}
