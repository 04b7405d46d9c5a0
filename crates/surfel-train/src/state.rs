//! A run on disk: weights, optimiser, position. Exact resume after any interruption.
//!
//! `checkpoint.safetensors` holds tensors `weight.*`, `average.*`, `first.*`, `second.*` and, in its header, the step and the
//! configuration. Invariant: the file is written beside its place and renamed, so there is always a whole one.

use crate::adam::{AdamState, Moments};
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::parameters::Named;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::Arc;

/// What a run is at some step.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Steps done.
    pub step: u64,
    /// Weights by name; shared with whoever computes with them.
    pub weights: Arc<Named>,
    /// Their mean over the last steps, by name; empty in a run without averaging.
    pub average: Named,
    /// Optimiser.
    pub adam: AdamState,
    /// Best score of a validation so far, and its step.
    pub best: Option<(f64, u64)>,
}

impl State {
    /// The start of a run.
    pub fn new(weights: Named) -> Self {
        Self { step: 0, weights: Arc::new(weights), average: Named::new(), adam: AdamState::default(), best: None }
    }

    /// Draws the mean towards the weights; the first weights weigh less than `decay` says, for they are the worst.
    pub fn average(&mut self, decay: f64) {
        if decay <= 0.0 {
            return;
        }
        let decay = decay.min((1.0 + self.step as f64) / (10.0 + self.step as f64)) as f32;
        for (name, weights) in self.weights.iter() {
            let mean = self.average.entry(name.clone()).or_insert_with(|| weights.clone());
            mean.iter_mut().zip(weights).for_each(|(mean, weight)| *mean += (1.0 - decay) * (weight - *mean));
        }
    }

    /// The weights that are measured and kept.
    pub fn kept(&self) -> &Named {
        if self.average.is_empty() { &self.weights } else { &self.average }
    }
}

/// Writes a checkpoint.
///
/// # Errors
/// When the file cannot be written.
pub fn save(state: &State, config: &TrainConfig, path: &Path) -> Result<(), TrainError> {
    let damaged = |reason: String| TrainError::Damaged { path: path.to_path_buf(), reason };
    let bytes = |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|value| value.to_le_bytes()).collect() };
    let mut tensors: Vec<(String, Vec<u8>)> = Vec::new();
    for (name, weights) in state.weights.iter() {
        tensors.push((format!("weight.{name}"), bytes(weights)));
    }
    for (name, average) in &state.average {
        tensors.push((format!("average.{name}"), bytes(average)));
    }
    for (name, moments) in &state.adam.moments {
        tensors.push((format!("first.{name}"), bytes(&moments.first)));
        tensors.push((format!("second.{name}"), bytes(&moments.second)));
    }
    let views = tensors.iter().map(|(name, bytes)| {
        let view = TensorView::new(Dtype::F32, vec![bytes.len() / 4], bytes);
        view.map(|view| (name.as_str(), view)).map_err(|error| damaged(error.to_string()))
    });
    let views = views.collect::<Result<Vec<_>, _>>()?;
    let mut header = HashMap::from([
        ("step".to_owned(), state.step.to_string()),
        ("adam_steps".to_owned(), state.adam.steps.to_string()),
        ("config".to_owned(), toml::to_string(config).map_err(|error| damaged(error.to_string()))?),
    ]);
    if let Some((share, step)) = state.best {
        header.insert("best".to_owned(), format!("{share} {step}"));
    }
    let file = safetensors::serialize(views, Some(header)).map_err(|error| damaged(error.to_string()))?;
    let beside = path.with_extension("part");
    std::fs::write(&beside, file).map_err(TrainError::unwritable(&beside))?;
    std::fs::rename(&beside, path).map_err(TrainError::unwritable(path))
}

/// Reads a checkpoint of the run that `config` describes.
///
/// # Errors
/// When it cannot be read, is damaged, or belongs to another configuration.
pub fn load(config: &TrainConfig, path: &Path) -> Result<State, TrainError> {
    let damaged = |reason: String| TrainError::Damaged { path: path.to_path_buf(), reason };
    let bytes = std::fs::read(path).map_err(TrainError::unreadable(path))?;
    let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|error| damaged(error.to_string()))?;
    let file = SafeTensors::deserialize(&bytes).map_err(|error| damaged(error.to_string()))?;
    let header = header.metadata().clone().unwrap_or_default();
    let text = |key: &str| header.get(key).ok_or_else(|| damaged(format!("its header has no {key}")));
    let number = |key: &str| text(key)?.parse().map_err(|_| damaged(format!("its {key} is not a number")));
    let stored = TrainConfig::from_toml(text("config")?).map_err(&damaged)?;
    if stored != *config {
        let reason = "its configuration differs".to_owned();
        return Err(TrainError::OtherRun { path: path.to_path_buf(), reason });
    }
    let (mut weights, mut average) = (Named::new(), Named::new());
    let mut moments: BTreeMap<String, Moments> = BTreeMap::new();
    for (name, tensor) in file.tensors() {
        let values: Vec<f32> = tensor.data().as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        match name.split_once('.') {
            Some(("weight", name)) => drop(weights.insert(name.to_owned(), values)),
            Some(("average", name)) => drop(average.insert(name.to_owned(), values)),
            Some(("first", name)) => moments.entry(name.to_owned()).or_default().first = values,
            Some(("second", name)) => moments.entry(name.to_owned()).or_default().second = values,
            _ => return Err(damaged(format!("nobody knows its tensor {name}"))),
        }
    }
    let best = header.get("best").and_then(|best| {
        let (share, step) = best.split_once(' ')?;
        Some((share.parse().ok()?, step.parse().ok()?))
    });
    let adam = AdamState { steps: number("adam_steps")?, moments };
    Ok(State { step: number("step")?, weights: Arc::new(weights), average, adam, best })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_follows_the_weights_and_stays_where_they_stay() {
        let weights = |value: f32| Named::from([("a".to_owned(), vec![value, 1.0])]);
        let mut state = State::new(weights(0.0));
        assert_eq!(state.kept(), &*state.weights);
        state.average(0.9);
        state.weights = Arc::new(weights(8.0));
        state.step = 1000;
        state.average(0.75);
        assert_eq!(state.kept(), &weights(2.0));
        (0..100).for_each(|_| state.average(0.75));
        assert!((state.kept()["a"][0] - 8.0).abs() < 1e-4);
    }
}
