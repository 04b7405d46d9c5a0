//! The samples of a step, side by side: each lane is a thread with a network of its own.
//!
//! One sample leaves most of a machine of many cores idle, and a card even more. Invariant: answers come in the order of
//! the samples, so what a step learns does not depend on how many lanes there are.

use super::order::pass;
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::loss::{self, Said};
use crate::parameters::{self, Named};
use crate::sample::Sample;
use burn::tensor::Device;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::Scope;
use surfel_loss::{Perceptual, Terms};
use surfel_net::SurfelNet;

/// What a sample says of the weights.
pub(super) struct Learned {
    pub loss: f64,
    /// As logged.
    pub terms: Vec<(&'static str, f64)>,
    pub gradients: Named,
}

/// `None` where nothing is known of the sample.
type Answer = Result<Option<Learned>, TrainError>;

/// Why a lane may be expected to answer: it ends early only where burn panics, which ends the run.
const LIVES: &str = "a lane lives as long as the run";

/// How samples are looked at.
#[derive(Clone)]
pub(super) struct Lesson {
    pub config: TrainConfig,
    pub perceptual: Arc<Perceptual>,
    pub device: Device,
}

/// A sample, the run's `number`th, with its step and the weights of that.
struct Task {
    number: u64,
    step: u64,
    weights: Arc<Named>,
    sample: Sample,
}

/// The threads.
pub(super) struct Lanes {
    lanes: Vec<(Sender<Task>, Receiver<Answer>)>,
}

impl Lanes {
    /// `count` lanes that live until this is dropped; each has its own leaves of the graph, or burn would join the graphs
    /// of all and differentiate one after the other.
    pub(super) fn start<'scope>(
        scope: &'scope Scope<'scope, '_>,
        count: usize,
        lesson: &Lesson,
        net: &SurfelNet,
    ) -> Self {
        let start = |_| {
            let (task_sender, tasks) = channel::<Task>();
            let (answers, answer_receiver) = channel();
            let (lesson, net) = (lesson.clone(), net.clone());
            scope.spawn(move || {
                for task in tasks {
                    if answers.send(lesson.learned(&net, task)).is_err() {
                        return;
                    }
                }
            });
            (task_sender, answer_receiver)
        };
        Self { lanes: (0..count).map(start).collect() }
    }

    fn lane(&self, sample: usize) -> &(Sender<Task>, Receiver<Answer>) {
        &self.lanes[sample % self.lanes.len()]
    }

    /// What the samples of `step` say of its `weights`, in their order.
    pub(super) fn learn(
        &self,
        step: u64,
        weights: &Arc<Named>,
        samples: Vec<Sample>,
    ) -> Result<Vec<Learned>, TrainError> {
        let batch = samples.len();
        for (i, sample) in samples.into_iter().enumerate() {
            let number = step * batch as u64 + i as u64;
            let task = Task { number, step, weights: weights.clone(), sample };
            self.lane(i).0.send(task).expect(LIVES);
        }
        let answers = (0..batch).map(|i| self.lane(i).1.recv().expect(LIVES));
        answers.filter_map(Result::transpose).collect()
    }
}

impl Lesson {
    fn learned(&self, net: &SurfelNet, task: Task) -> Answer {
        let step = task.step;
        let net = parameters::assign(net.clone(), &task.weights);
        let terms = self.terms(&net, &task)?;
        let Some(total) = terms.total() else { return Ok(None) };
        let loss = f64::from(total.clone().into_scalar::<f32>());
        if !loss.is_finite() {
            return Err(TrainError::Diverged { step, loss });
        }
        let terms = terms.named();
        Ok(Some(Learned { loss, terms, gradients: parameters::gradients(&net, &total.backward()) }))
    }

    /// What is wrong with the network's answer; surfels are made only when a term looks at them.
    fn terms(&self, net: &SurfelNet, Task { number, step, sample, .. }: &Task) -> Result<Terms, TrainError> {
        let Self { config, perceptual, device } = self;
        let (input, weights) = (sample.input(net.config()), &config.loss.at(*step));
        if weights.needs_surfels() {
            let prediction = net.forward(&input, device)?;
            return loss::terms((&prediction).into(), sample, weights, perceptual, device);
        }
        // Up to the pass that this sample teaches.
        let taught = net.clone().with_passes(pass(net.config().passes(), config.seed, *number));
        let maps = taught.forward_maps(&input, device)?;
        loss::terms(Said { maps: &maps, surfels: None }, sample, weights, perceptual, device)
    }
}
