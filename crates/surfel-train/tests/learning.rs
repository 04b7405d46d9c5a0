//! A short training on analytic scenes must teach something, and an interrupted one must be the same one.

use std::path::Path;
use std::sync::Mutex;
use surfel_train::parameters;
use surfel_train::trainer::StepReport;
use surfel_train::validate::Validation;
use surfel_train::{Places, RenderedWeights, TrainConfig, Trainer, Watcher};

/// The shipped graph, narrow, with a rate of learning.
fn config(rate: f64, steps: u64) -> TrainConfig {
    let network = include_str!("../../surfel-net/presets/small.toml")
        .replace("kind = \"pretrained\"\nchannels = 32", "kind = \"cnn\"\nchannels = 16\nwidths = [8, 8]")
        .replace("upsampled_channels = 16", "upsampled_channels = 8")
        .replace("channels = 24, multipliers = [1, 2, 2, 4]", "channels = 8, multipliers = [1, 2]")
        .replace("num_candidates = 9, step = 0.5, channels = 16", "num_candidates = 5, step = 0.5, channels = 8")
        .replace("channels = 32\nnum_heads = 2", "channels = 16\nnum_heads = 2");
    let source = "kind = \"analytic\"\nwidth = 64\nheight = 48\nnum_views = 2\n";
    let text = format!(
        "network = '''\n{network}'''\nseed = 5\nsteps = {steps}\nbatch = 1\nclip = 1.0\naveraging = 0.8\n\
         [rate]\nrate = {rate:e}\nrise = 0.1\nfirst_division = 10.0\nlast_division = 10.0\n\
         [loss]\ndepth = 1.0\nnormal = 1.0\ninitial_normal = 0.5\nopacity = 0.2\n\
         rendered = {{ photometric = 0.5, perceptual = 0.05, alignment = 0.05, depth = 0.1 }}\n\
         [[train]]\nnum_samples = 12\nseed = 1\n{source}\
         [[validation]]\nnum_samples = 4\nseed = 2\n{source}\
         [every]\nlog = 2\nvalidate = 1000\ncheckpoint = 4\npictures = 6\n"
    );
    TrainConfig::from_toml(&text).unwrap()
}

/// The same taught by the encoder's maps alone, as the depth of the shipped weights was.
fn maps_only(rate: f64, steps: u64) -> TrainConfig {
    let mut config = config(rate, steps);
    let loss = &mut config.loss;
    (loss.normal, loss.initial_normal, loss.plane_normal) = (0.0, 0.0, 0.5);
    loss.rendered = RenderedWeights::default();
    config
}

#[derive(Default)]
struct Losses(Mutex<Vec<(u64, f64)>>);

impl Watcher for Losses {
    fn logged(&self, report: &StepReport) {
        self.0.lock().unwrap().push((report.step, report.loss));
    }

    fn validated(&self, _: u64, _: &Validation) {}
}

fn places(cache: &Path) -> Places<'_> {
    Places { cache: Some(cache), ..Places::default() }
}

/// Runs to the end; returns scores before and after.
fn train(config: TrainConfig, folder: &Path, cache: &Path) -> (Validation, Validation) {
    let steps = config.steps;
    let mut trainer = Trainer::new(config, folder, places(cache)).unwrap();
    let before = trainer.validate().unwrap();
    trainer.run(steps, &Losses::default()).unwrap();
    (before, trainer.validate().unwrap())
}

/// What a run must bring, on scenes it has not seen: less depth error, and confidence that means something.
fn has_learned(before: &Validation, after: &Validation) -> bool {
    let [before, after] = [before, after].map(|validation| validation.network.unwrap());
    after.median_pct < 0.99 * before.median_pct
        && after.within_1pct > before.within_1pct
        && after.calibration < 0.7 * before.calibration
}

#[test]
fn a_short_run_learns_and_one_that_cannot_learn_is_found_out() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("samples");
    let (before, after) = train(maps_only(2e-3, 400), &folder.path().join("learns"), &cache);
    assert!(has_learned(&before, &after), "before {before:#?}\nafter {after:#?}");
    let (before, after) = train(maps_only(1e-12, 4), &folder.path().join("cannot"), &cache);
    assert!(!has_learned(&before, &after));
}

#[test]
fn a_step_learns_the_same_in_any_number_of_lanes() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("samples");
    let learned = |lanes: usize| {
        let (losses, config) = (Losses::default(), TrainConfig { batch: 3, ..maps_only(1e-3, 4) });
        let trainer = Trainer::new(config, &folder.path().join(lanes.to_string()), places(&cache)).unwrap();
        let mut trainer = trainer.with_lanes(lanes);
        trainer.run(4, &losses).unwrap();
        (losses.0.into_inner().unwrap(), parameters::read(&trainer.kept_net()))
    };
    let alone = learned(1);
    assert_eq!(alone.0.len(), 2);
    assert!(alone == learned(2) && alone == learned(3));
}

#[test]
fn only_what_is_to_learn_learns() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("samples");
    let config = TrainConfig { learns: vec!["head".to_owned(), "aggregation".to_owned()], ..config(1e-3, 3) };
    let mut trainer = Trainer::new(config.clone(), &folder.path().join("run"), places(&cache)).unwrap();
    let before = parameters::read(&trainer.kept_net());
    trainer.run(3, &Losses::default()).unwrap();
    let after = parameters::read(&trainer.kept_net());
    for (name, weights) in &before {
        let learns = ["head", "aggregation"].iter().any(|part| name.starts_with(part));
        assert!(learns || *weights == after[name], "{name} has learned");
    }
    assert_ne!(before["head.second.weight"], after["head.second.weight"]);

    let misspelt = TrainConfig { learns: vec!["heads".to_owned()], ..config };
    let error = Trainer::new(misspelt, &folder.path().join("other"), places(&cache)).err().unwrap().to_string();
    assert!(error.contains("`learns` names \"heads\""), "{error}");
}

#[test]
fn a_resumed_run_is_the_same_run() {
    let folder = tempfile::tempdir().unwrap();
    let cache = folder.path().join("samples");
    let losses = |folder: &Path, stops: &[u64]| {
        let losses = Losses::default();
        for stop in stops {
            let mut trainer = Trainer::new(config(1e-3, 12), folder, places(&cache)).unwrap();
            trainer.run(*stop, &losses).unwrap();
        }
        (losses.0.into_inner().unwrap(), std::fs::read_to_string(folder.join("metrics.jsonl")).unwrap())
    };
    let (whole, whole_metrics) = losses(&folder.path().join("whole"), &[12]);
    let (parts, metrics) = losses(&folder.path().join("parts"), &[4, 8, 12]);
    assert_eq!(whole, parts);
    // Six intervals and the validation at the end.
    assert_eq!(metrics.lines().count(), 7);
    // The mean of the weights is resumed, too.
    assert_eq!(metrics.lines().last(), whole_metrics.lines().last());
    assert!(metrics.lines().last().unwrap().contains("validation"));
    let pictures = ["0000006.png", "0000012.png"].map(|name| folder.path().join("parts/pictures").join(name));
    assert!(pictures.iter().all(|path| std::fs::metadata(path).is_ok_and(|file| file.len() > 1000)));
    let other = Trainer::new(config(2e-3, 12), &folder.path().join("parts"), places(&cache));
    assert!(other.err().unwrap().to_string().contains("checkpoint of another run"));
}
