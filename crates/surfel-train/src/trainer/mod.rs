//! The loop: samples in, weights out, everything on disk.
//!
//! Samples are made by a thread of their own while the network computes. Which sample a step sees follows from
//! the seed and the step alone. Invariant: after a kill, the resumed run writes the same losses that the
//! uninterrupted one would have.

mod order;
mod start;

use crate::adam::{Adam, clipping};
use crate::cache::Cache;
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::loss::{self, Said};
use crate::metrics::{self, METRICS, Meter};
use crate::parameters::{self, Named};
use crate::pictures;
use crate::sample::Sample;
use crate::state::{self, State};
use crate::validate::{Validation, validate};
use burn::tensor::Device;
use order::{draw, pass};
use std::path::PathBuf;
use std::sync::mpsc::sync_channel;
use surfel_loss::{Perceptual, Terms};
use surfel_net::{SurfelNet, checkpoint};

pub use crate::metrics::StepReport;
pub use start::Places;

/// Samples made ahead of their use.
const AHEAD: usize = 2;
/// The checkpoint in a run's folder.
const CHECKPOINT: &str = "checkpoint.safetensors";

/// Who is told how it goes.
pub trait Watcher: Sync {
    /// After the steps of a logging interval.
    fn logged(&self, report: &StepReport);
    /// After a validation.
    fn validated(&self, step: u64, validation: &Validation);
}

/// A run.
pub struct Trainer {
    config: TrainConfig,
    folder: PathBuf,
    device: Device,
    net: SurfelNet,
    perceptual: Perceptual,
    state: State,
    train: Vec<(u64, Cache)>,
    validation: Vec<(u64, Cache)>,
}

impl Trainer {
    /// Steps done.
    pub fn step(&self) -> u64 {
        self.state.step
    }

    /// The network that would be kept now: the mean of the last steps where the run averages.
    pub fn kept_net(&self) -> SurfelNet {
        parameters::assign(self.net.clone(), self.state.kept())
    }

    /// Makes all samples without training, so that they are in the cache; calls `made` after each.
    ///
    /// # Errors
    /// When a sample cannot be made.
    pub fn prepare(&self, made: impl Fn(u64)) -> Result<(), TrainError> {
        let sides = self.validation.iter().chain(&self.train);
        let numbers = sides.flat_map(|(count, cache)| (0..*count).map(move |number| (cache, number)));
        for (done, (cache, number)) in numbers.enumerate() {
            cache.sample(number)?;
            made(done as u64 + 1);
        }
        Ok(())
    }

    /// Runs until `until` steps are done (at most those of the configuration).
    ///
    /// # Errors
    /// When a sample, a file or the loss goes wrong.
    pub fn run(&mut self, until: u64, watcher: &dyn Watcher) -> Result<(), TrainError> {
        let until = until.min(self.config.steps);
        let batch = self.config.batch as u64;
        let numbers = self.state.step * batch..until * batch;
        let (train, config) = (std::mem::take(&mut self.train), self.config.clone());
        let (sender, receiver) = sync_channel::<Result<Sample, TrainError>>(AHEAD);
        let result = std::thread::scope(|scope| {
            let train = &train;
            scope.spawn(move || {
                for number in numbers {
                    let sample = draw(train, &config, number);
                    let failed = sample.is_err();
                    if sender.send(sample).is_err() || failed {
                        return;
                    }
                }
            });
            self.steps(until, watcher, || receiver.recv().unwrap_or(Err(TrainError::EmptyScene)))
        });
        self.train = train;
        result
    }

    fn steps(
        &mut self,
        until: u64,
        watcher: &dyn Watcher,
        mut next: impl FnMut() -> Result<Sample, TrainError>,
    ) -> Result<(), TrainError> {
        let mut meter = Meter::new();
        while self.state.step < until {
            let samples = (0..self.config.batch).map(|_| next()).collect::<Result<Vec<_>, _>>()?;
            self.learn(&samples, &mut meter)?;
            let step = self.state.step;
            let due = |every: u64| step.is_multiple_of(every) || step == self.config.steps;
            if due(self.config.every.log) {
                let report = meter.report(step, self.config.steps, self.rate(step - 1));
                metrics::append(&self.folder.join(METRICS), &report.to_json())?;
                watcher.logged(&report);
                meter = Meter::new();
            }
            if due(self.config.every.validate) && !self.validation.is_empty() {
                let validation = self.validate()?;
                let line = serde_json::json!({ "step": step, "validation": validation });
                metrics::append(&self.folder.join(METRICS), &line)?;
                watcher.validated(step, &validation);
                if let Some(score) = validation.score()
                    && self.state.best.is_none_or(|(best, _)| score > best)
                {
                    self.state.best = Some((score, step));
                    checkpoint::save(&self.kept_net(), &self.folder.join("best.safetensors"))?;
                }
            }
            if self.config.every.pictures > 0 && due(self.config.every.pictures) {
                self.picture(step)?;
            }
            if due(self.config.every.checkpoint) || step == until {
                state::save(&self.state, &self.config, &self.folder.join(CHECKPOINT))?;
                checkpoint::save(&self.kept_net(), &self.folder.join("last.safetensors"))?;
            }
        }
        Ok(())
    }

    /// Draws what the network says of the first validation sample.
    fn picture(&self, step: u64) -> Result<(), TrainError> {
        use burn::module::Module as _;
        let Some((_, cache)) = self.validation.first() else { return Ok(()) };
        let path = self.folder.join(format!("pictures/{step:07}.png"));
        pictures::write(&self.kept_net().valid(), &cache.sample(0)?, &path)
    }

    fn rate(&self, step: u64) -> f64 {
        self.config.rate.at(step, self.config.steps)
    }

    /// What is wrong with the network's answer; surfels are made only when a term looks at them.
    fn terms(&self, sample: &Sample) -> Result<Terms, TrainError> {
        let (input, weights) = (sample.input(self.net.config()), &self.config.loss.at(self.state.step));
        if weights.needs_surfels() {
            let prediction = self.net.forward(&input, &self.device)?;
            return loss::terms((&prediction).into(), sample, weights, &self.perceptual, &self.device);
        }
        let maps = self.pass_taught().forward_maps(&input, &self.device)?;
        loss::terms(Said { maps: &maps, surfels: None }, sample, weights, &self.perceptual, &self.device)
    }

    /// The network up to the pass that this step teaches.
    fn pass_taught(&self) -> SurfelNet {
        let passes = self.net.config().passes();
        self.net.clone().with_passes(pass(passes, self.config.seed, self.state.step))
    }

    /// One step of the optimiser.
    fn learn(&mut self, samples: &[Sample], meter: &mut Meter) -> Result<(), TrainError> {
        let mut gradients = Named::new();
        let share = 1.0 / samples.len() as f32;
        for sample in samples {
            let terms = self.terms(sample)?;
            let Some(total) = terms.total() else { continue };
            let value = f64::from(total.clone().into_scalar::<f32>());
            if !value.is_finite() {
                return Err(TrainError::Diverged { step: self.state.step, loss: value });
            }
            meter.add_loss(value, &terms.named());
            let grads = parameters::gradients(&self.net, &total.backward());
            for (name, new) in grads {
                let sum = gradients.entry(name).or_insert_with(|| vec![0.0; new.len()]);
                sum.iter_mut().zip(new).for_each(|(sum, new)| *sum += share * new);
            }
        }
        if gradients.is_empty() {
            return Err(TrainError::NothingToLearn { step: self.state.step });
        }
        let (norm, factor) = clipping(gradients.values(), self.config.clip);
        let rate = self.rate(self.state.step);
        Adam::default().step(&mut self.state.adam, &mut self.state.weights, &gradients, rate, factor);
        let net = self.net.clone();
        self.net = parameters::assign(net, &self.state.weights);
        self.state.step += 1;
        self.state.average(self.config.averaging);
        meter.add_step(norm);
        Ok(())
    }

    /// Scores on the validation samples.
    ///
    /// # Errors
    /// When one cannot be made.
    pub fn validate(&self) -> Result<Validation, TrainError> {
        use burn::module::Module as _;
        let samples = self.validation.iter().flat_map(|(count, cache)| (0..*count).map(|n| cache.sample(n)));
        validate(&self.kept_net().valid(), samples)
    }
}
