//! The log of a run: one JSON document a line, means over an interval of steps or a validation.
//!
//! Under `trainer`. Invariant: a term's mean is over the samples that have its truth, and a term that none had is absent.

use crate::error::TrainError;
use std::io::Write as _;
use std::path::Path;
use std::time::Instant;

/// The log in a run's folder.
pub(crate) const METRICS: &str = "metrics.jsonl";

/// Means over a logging interval.
#[derive(Clone, Debug, PartialEq)]
pub struct StepReport {
    /// Steps done.
    pub step: u64,
    /// Steps of the run.
    pub steps: u64,
    /// Weighted loss.
    pub loss: f64,
    /// Terms by name, unweighted, each over the samples that have its truth.
    pub terms: Vec<(&'static str, f64)>,
    /// Norm of the gradient before clipping.
    pub gradient_norm: f64,
    /// Learning rate of the last step.
    pub rate: f64,
    /// Seconds per step.
    pub seconds_per_step: f64,
}

/// What has been learned since the last line.
pub(crate) struct Meter {
    start: Instant,
    steps: f64,
    samples: f64,
    loss: f64,
    norm: f64,
    terms: Vec<TermSum>,
}

/// A term over the samples that have it.
struct TermSum {
    name: &'static str,
    sum: f64,
    samples: f64,
}

impl Meter {
    pub(crate) fn new() -> Self {
        Self { start: Instant::now(), steps: 0.0, samples: 0.0, loss: 0.0, norm: 0.0, terms: Vec::new() }
    }

    /// Adds the weighted loss of a sample and its terms.
    pub(crate) fn add_loss(&mut self, loss: f64, terms: &[(&'static str, f64)]) {
        self.samples += 1.0;
        self.loss += loss;
        for (name, value) in terms {
            match self.terms.iter_mut().find(|term| term.name == *name) {
                Some(term) => (term.sum, term.samples) = (term.sum + value, term.samples + 1.0),
                None => self.terms.push(TermSum { name, sum: *value, samples: 1.0 }),
            }
        }
    }

    /// Adds a step with the norm of its gradient.
    pub(crate) fn add_step(&mut self, norm: f64) {
        self.steps += 1.0;
        self.norm += norm;
    }

    /// The means so far, after `step` of `steps`.
    pub(crate) fn report(&self, step: u64, steps: u64, rate: f64) -> StepReport {
        StepReport {
            step,
            steps,
            loss: self.loss / self.samples,
            terms: self.terms.iter().map(|term| (term.name, term.sum / term.samples)).collect(),
            gradient_norm: self.norm / self.steps,
            rate,
            seconds_per_step: self.start.elapsed().as_secs_f64() / self.steps,
        }
    }
}

impl StepReport {
    pub(crate) fn to_json(&self) -> serde_json::Value {
        let terms: serde_json::Map<_, _> =
            self.terms.iter().map(|(name, v)| ((*name).to_owned(), (*v).into())).collect();
        serde_json::json!({
            "step": self.step, "loss": self.loss, "terms": terms, "gradient_norm": self.gradient_norm,
            "rate": self.rate, "seconds_per_step": self.seconds_per_step,
        })
    }
}

/// Writes one more line.
///
/// # Errors
/// When the file cannot be written.
pub(crate) fn append(path: &Path, line: &serde_json::Value) -> Result<(), TrainError> {
    let file = std::fs::OpenOptions::new().create(true).append(true).open(path);
    file.and_then(|mut file| writeln!(file, "{line}")).map_err(TrainError::unwritable(path))
}

/// Drops what was logged after the checkpoint: those steps are taken again.
///
/// # Errors
/// When the file cannot be read or written.
pub(crate) fn forget_after(path: &Path, step: u64) -> Result<(), TrainError> {
    if !path.is_file() {
        return Ok(());
    }
    let text = std::fs::read_to_string(path).map_err(TrainError::unreadable(path))?;
    let kept: String = text
        .lines()
        .filter(|line| {
            let value: Option<serde_json::Value> = serde_json::from_str(line).ok();
            value.and_then(|value| value["step"].as_u64()).is_some_and(|at| at <= step)
        })
        .map(|line| format!("{line}\n"))
        .collect();
    std::fs::write(path, kept).map_err(TrainError::unwritable(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_term_that_some_samples_lack_is_the_mean_of_the_others() {
        let mut meter = Meter::new();
        meter.add_loss(1.0, &[("photometric", 0.5)]);
        meter.add_loss(3.0, &[("depth", 4.0), ("photometric", 1.5)]);
        (0..2).for_each(|_| meter.add_step(2.0));
        let report = meter.report(2, 9, 1e-3);
        assert_eq!(report.terms, [("photometric", 1.0), ("depth", 4.0)]);
        assert_eq!((report.loss, report.gradient_norm), (2.0, 2.0));
    }
}
