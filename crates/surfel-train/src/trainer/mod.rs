//! The loop: samples in, weights out, everything on disk.
//!
//! Samples are made by threads of their own while the network computes, a step's samples side by side where there are
//! cores for it. Which sample a step sees follows from the seed and the step alone. Invariant: after a kill, the resumed
//! run writes the same losses that the uninterrupted one would have.

mod ahead;
mod lanes;
mod order;
mod start;

use crate::adam::{Adam, clipping};
use crate::cache::Cache;
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::metrics::{self, METRICS, Meter};
use crate::parameters::{self, Named};
use crate::pictures;
use crate::sample::Sample;
use crate::state::{self, State};
use crate::validate::{Validation, validate};
use ahead::ahead;
use burn::tensor::Device;
use lanes::{Lanes, Lesson};
use order::draw;
use std::path::PathBuf;
use std::sync::Arc;
use surfel_loss::Perceptual;
use surfel_net::{SurfelNet, checkpoint};

pub use crate::metrics::StepReport;
pub use start::Places;

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
    perceptual: Arc<Perceptual>,
    state: State,
    lanes: usize,
    train: Vec<(u64, Cache)>,
    validation: Vec<(u64, Cache)>,
}

impl Trainer {
    /// With `lanes` samples of a step (at least one) computed side by side, on as many threads; without it there is one
    /// for every two cores, since most operators use several themselves. Each needs the memory of a step.
    pub fn with_lanes(self, lanes: usize) -> Self {
        Self { lanes: lanes.max(1), ..self }
    }

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
        let samples: Vec<_> = sides.flat_map(|(count, cache)| (0..*count).map(move |n| (cache, n))).collect();
        let make = |i: u64| {
            let (cache, number) = samples[i as usize];
            cache.sample(number)
        };
        std::thread::scope(|scope| {
            let mut next = ahead(scope, cores(), 0..samples.len() as u64, &make);
            (1..=samples.len() as u64).try_for_each(|done| next().map(|_| made(done)))
        })
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
        let lesson = Lesson { config, perceptual: self.perceptual.clone(), device: self.device.clone() };
        let make = |number| draw(&train, &lesson.config, number);
        let result = std::thread::scope(|scope| {
            let next = ahead(scope, cores().div_ceil(2), numbers, &make);
            let lanes = Lanes::start(scope, self.lanes.min(self.config.batch), &lesson, &self.net);
            self.steps(until, watcher, next, &lanes)
        });
        self.train = train;
        result
    }

    fn steps(
        &mut self,
        until: u64,
        watcher: &dyn Watcher,
        mut next: impl FnMut() -> Result<Sample, TrainError>,
        lanes: &Lanes,
    ) -> Result<(), TrainError> {
        let mut meter = Meter::new();
        while self.state.step < until {
            let samples = (0..self.config.batch).map(|_| next()).collect::<Result<Vec<_>, _>>()?;
            self.learn(samples, lanes, &mut meter)?;
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

    /// One step of the optimiser.
    fn learn(&mut self, samples: Vec<Sample>, lanes: &Lanes, meter: &mut Meter) -> Result<(), TrainError> {
        let mut gradients = Named::new();
        let (step, share) = (self.state.step, 1.0 / samples.len() as f32);
        for learned in lanes.learn(step, &self.state.weights, samples)? {
            meter.add_loss(learned.loss, &learned.terms);
            for (name, new) in learned.gradients {
                let sum = gradients.entry(name).or_insert_with(|| vec![0.0; new.len()]);
                sum.iter_mut().zip(new).for_each(|(sum, new)| *sum += share * new);
            }
        }
        if gradients.is_empty() {
            return Err(TrainError::NothingToLearn { step });
        }
        let (norm, factor) = clipping(gradients.values(), self.config.clip);
        let rate = self.rate(step);
        // The lanes have let go of the weights, so nothing is copied.
        let weights = Arc::make_mut(&mut self.state.weights);
        Adam::default().step(&mut self.state.adam, weights, &gradients, rate, factor);
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

/// Cores of this machine.
fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
