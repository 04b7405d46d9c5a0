//! A run on disk: weights, optimiser, position. Exact resume after any interruption.
//!
//! `checkpoint.safetensors` holds tensors `weight.*`, `first.*`, `second.*` and, in its header, the step and the
//! configuration. Invariant: the file is written beside its place and renamed, so there is always a whole one.

use crate::adam::{AdamState, Moments};
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::parameters::Named;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// What a run is at some step.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Steps done.
    pub step: u64,
    /// Weights by name.
    pub weights: Named,
    /// Optimiser.
    pub adam: AdamState,
    /// Best share within 1 % so far, and its step.
    pub best: Option<(f64, u64)>,
}

/// Writes a checkpoint.
///
/// # Errors
/// When the file cannot be written.
pub fn save(state: &State, config: &TrainConfig, path: &Path) -> Result<(), TrainError> {
    let damaged = |reason: String| TrainError::Damaged { path: path.to_path_buf(), reason };
    let bytes = |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|value| value.to_le_bytes()).collect() };
    let mut tensors: Vec<(String, Vec<u8>)> = Vec::new();
    for (name, weights) in &state.weights {
        tensors.push((format!("weight.{name}"), bytes(weights)));
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
    let mut weights = Named::new();
    let mut moments: BTreeMap<String, Moments> = BTreeMap::new();
    for (name, tensor) in file.tensors() {
        let values: Vec<f32> = tensor.data().as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        match name.split_once('.') {
            Some(("weight", name)) => drop(weights.insert(name.to_owned(), values)),
            Some(("first", name)) => moments.entry(name.to_owned()).or_default().first = values,
            Some(("second", name)) => moments.entry(name.to_owned()).or_default().second = values,
            _ => return Err(damaged(format!("nobody knows its tensor {name}"))),
        }
    }
    let best = header.get("best").and_then(|best| {
        let (share, step) = best.split_once(' ')?;
        Some((share.parse().ok()?, step.parse().ok()?))
    });
    Ok(State { step: number("step")?, weights, adam: AdamState { steps: number("adam_steps")?, moments }, best })
}
