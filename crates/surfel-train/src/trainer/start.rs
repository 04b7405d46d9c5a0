//! The beginning of a run, or of its going on: network, state, sources.
//!
//! Invariant: a run that goes on has the weights, the optimiser and the position it was stopped with.

use super::{CHECKPOINT, Trainer, cores};
use crate::cache::Cache;
use crate::config::{SourceEntry, TrainConfig};
use crate::error::TrainError;
use crate::metrics::{self, METRICS};
use crate::parameters;
use crate::source::Source;
use crate::state::{self, State};
use burn::tensor::Device;
use std::path::Path;
use std::sync::{Arc, Mutex};
use surfel_loss::{Lpips, Perceptual};
use surfel_net::{NetConfig, SurfelNet, checkpoint};
use surfel_synth::Split;

/// Where things are that are no part of a run's settings.
#[derive(Clone, Copy, Debug, Default)]
pub struct Places<'a> {
    /// Folder of scans, textures and light maps.
    pub assets: Option<&'a Path>,
    /// Folder that keeps samples.
    pub cache: Option<&'a Path>,
    /// Weights to start from.
    pub initial: Option<&'a Path>,
    /// Weights of LPIPS; without them the perceptual term is `1 - SSIM`.
    pub lpips: Option<&'a Path>,
    /// Where the network computes; the CPU by default. Samples are always made on the CPU.
    pub device: Option<&'a Device>,
}

impl Trainer {
    /// Starts a run in `folder`, or goes on with the one that is there.
    ///
    /// # Errors
    /// When assets, folder, checkpoint or weights cannot be used.
    pub fn new(
        config: TrainConfig,
        folder: &Path,
        Places { assets, cache, initial, lpips, device }: Places,
    ) -> Result<Self, TrainError> {
        std::fs::create_dir_all(folder).map_err(TrainError::unwritable(folder))?;
        let device = device.cloned().unwrap_or_else(Device::flex).autodiff();
        let unusable = |reason| TrainError::Config { path: folder.to_path_buf(), reason };
        let mut net = fresh(config.network().map_err(unusable)?, config.seed, &device)?;
        let path = folder.join(CHECKPOINT);
        let state = if path.is_file() {
            let state = state::load(&config, &path)?;
            net = parameters::assign(net, &state.weights);
            state
        } else {
            if let Some(path) = initial {
                net = checkpoint::load(net, path)?;
            }
            State::new(parameters::read(&net))
        };
        if !config.learns.is_empty() {
            let unknown = |part: &str| unusable(format!("`learns` names {part:?}, but no weight begins with it"));
            net = parameters::learning(net, &config.learns).map_err(unknown)?;
        }
        metrics::forget_after(&folder.join(METRICS), state.step)?;
        // Validation sets every network beside matching.
        let matching = |split| net.config().seeded.is_some() || split == Split::Val;
        let open = |entries: &[SourceEntry], split: Split, side: &str| {
            let open = |entry: &SourceEntry| {
                let source = Source::open(&entry.source, split, assets)?;
                let source = if matching(split) { source } else { source.without_matching() };
                Ok((entry.num_samples, Cache::new(source, cache, side)?))
            };
            entries.iter().map(open).collect::<Result<Vec<_>, TrainError>>()
        };
        let train = open(&config.train, Split::Train, "train")?;
        let validation = open(&config.validation, Split::Val, "val")?;
        let perceptual = match lpips {
            Some(path) => Perceptual::Lpips(Box::new(Lpips::from_file(path, &device)?)),
            None => Perceptual::Ssim,
        };
        let perceptual = Arc::new(perceptual);
        let (folder, lanes) = (folder.to_path_buf(), cores().div_ceil(2));
        Ok(Self { config, folder, device, net, perceptual, state, lanes, train, validation })
    }
}

/// The network that a seed names, whatever the device: drawn on the CPU. All of a process draw from one generator,
/// hence one after the other.
fn fresh(config: NetConfig, seed: u64, device: &Device) -> Result<SurfelNet, TrainError> {
    use burn::module::Module as _;
    static DRAWING: Mutex<()> = Mutex::new(());
    let _one_at_a_time = DRAWING.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let cpu = Device::flex().autodiff();
    cpu.seed(seed);
    let net = SurfelNet::new(config, &cpu)?;
    Ok(if *device == cpu { net } else { net.fork(device) })
}
