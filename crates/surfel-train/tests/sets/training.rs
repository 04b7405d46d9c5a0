//! Two steps on each set: what is known is taught, what is not is neither taught nor stated.

use crate::layouts::{blended_mvs, clips, dtu};
use std::path::Path;
use surfel_core::Camera;
use surfel_synth::Split;
use surfel_train::config::Intervals;
use surfel_train::source::{Beginning, Scenes, Source};
use surfel_train::trainer::StepReport;
use surfel_train::validate::Validation;
use surfel_train::{Places, TrainConfig, Trainer, Watcher};

/// A run of two steps on a source, written in TOML without its size.
pub fn config(source: &str) -> TrainConfig {
    let source = format!("num_samples = 4\nseed = 1\nwidth = 64\nheight = 48\nnum_views = 2\n{source}\n");
    let text = format!(
        "network = \"tiny\"\nseed = 5\nsteps = 2\nbatch = 1\nclip = 1.0\n\
         [rate]\nrate = 1e-3\nrise = 0.1\nfirst_division = 10.0\nlast_division = 10.0\n\
         [loss]\ndepth = 1.0\nnormal = 1.0\ninitial_normal = 0.5\nopacity = 0.2\nobject_factor = 3.0\n\
         rendered = {{ photometric = 1.0, perceptual = 0.05, depth = 0.1, normal = 0.1, silhouette = 0.1 }}\n\
         [[train]]\n{source}[[validation]]\n{source}\
         [every]\nlog = 1\nvalidate = 2\ncheckpoint = 2\npictures = 2\n"
    );
    TrainConfig::from_toml(&text).unwrap()
}

struct Silent;

impl Watcher for Silent {
    fn logged(&self, _: &StepReport) {}
    fn validated(&self, _: u64, _: &Validation) {}
}

/// Names of the terms of every step, and the validation at the end.
fn trained(config: TrainConfig, folder: &Path) -> (Vec<Vec<String>>, serde_json::Value) {
    let (run, cache) = (folder.join("run"), folder.join("samples"));
    let mut trainer = Trainer::new(config, &run, Places { cache: Some(&cache), ..Places::default() }).unwrap();
    trainer.run(2, &Silent).unwrap();
    let metrics = std::fs::read_to_string(run.join("metrics.jsonl")).unwrap();
    let lines: Vec<serde_json::Value> = metrics.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let names = |line: &serde_json::Value| line["terms"].as_object().unwrap().keys().cloned().collect();
    (lines[..2].iter().map(names).collect(), lines[2]["validation"].clone())
}

const OF_PHOTOGRAPHS: [&str; 2] = ["photometric", "ssim"];
const OF_MEASURED: [&str; 5] = ["depth", "opacity", "photometric", "rendered_depth", "ssim"];

#[test]
fn clips_teach_what_photographs_alone_can_tell() {
    for kind in ["re10k", "acid"] {
        let folder = tempfile::tempdir().unwrap();
        // One clip is too short and passed over.
        clips(&folder.path().join("set"), &[7, 2, 6]);
        let source = format!("kind = \"{kind}\"\nfolder = {:?}\nmin_gap = 2\nmax_gap = 4", folder.path().join("set"));
        let (terms, validation) = trained(config(&source), folder.path());
        assert_eq!(terms, [OF_PHOTOGRAPHS; 2]);
        assert!(validation["network"].is_null() && validation["matching"].is_null(), "{validation}");
        assert!(!folder.path().join("run/best.safetensors").exists());

        std::fs::remove_dir_all(folder.path().join("run")).unwrap();
        let (_, validation) = trained(config(&format!("num_targets = 1\n{source}")), folder.path());
        assert!((3.0..40.0).contains(&validation["new_views_psnr"].as_f64().unwrap()), "{validation}");
        assert!(folder.path().join("run/best.safetensors").exists());
    }
}

#[test]
fn gaps_grow_from_sample_to_sample() {
    let folder = tempfile::tempdir().unwrap();
    clips(&folder.path().join("set"), &[9, 9]);
    let text = format!(
        "kind = \"re10k\"\nfolder = {:?}\nmin_gap = 8\nmax_gap = 8\nfrom = {{ min_gap = 2, max_gap = 2, over = 6 }}",
        folder.path().join("set")
    );
    let source = Source::open(&config(&text).train[0].source, Split::Train, None).unwrap().without_matching();
    let baseline = |number: u64| {
        let sample = source.sample(number).unwrap();
        sample.cameras[0].centre().distance(sample.cameras[1].centre())
    };
    let [first, middle, last, later] = [0, 3, 6, 60].map(baseline);
    // The cameras stand on an arc, whose chords grow a little less than their number of frames: 2, 5, 8 and 8.
    let [middle, last, later] = [middle, last, later].map(|baseline| baseline / first);
    assert!((2.3..2.6).contains(&middle) && (3.5..4.1).contains(&last), "{middle} {last}");
    assert!((0.9..1.1).contains(&(later / last)), "{later} {last}");
    let mut backwards = config(&text);
    if let Scenes::Re10k(clips) = &mut backwards.train[0].source.scenes {
        clips.from = Some(Beginning { min_gap: 5, max_gap: 2, over: 6 });
    }
    let said = TrainConfig::from_toml(&toml::to_string(&backwards).unwrap()).unwrap_err();
    assert!(said.contains("from.min_gap = 5 and from.max_gap = 2"), "{said}");
}

/// A stage as it ships, with the narrowest network, on a set of two photographs' size.
fn shipped(stage: &str, set: &Path) -> TrainConfig {
    let mut config = TrainConfig::from_toml(stage).unwrap();
    (config.network, config.steps, config.batch) = ("tiny".to_owned(), 2, 1);
    config.every = Intervals { log: 1, validate: 2, checkpoint: 2, pictures: 0 };
    for entry in config.train.iter_mut().chain(&mut config.validation) {
        (entry.num_samples, entry.source.width, entry.source.height) = (2, 64, 48);
        match &mut entry.source.scenes {
            Scenes::Re10k(clips) => {
                (clips.folder, clips.min_gap, clips.max_gap) = (set.to_owned(), 5, 7);
                clips.from = clips.from.map(|from| Beginning { min_gap: 5, max_gap: 6, ..from });
            }
            Scenes::Dtu(dtu) => dtu.folder = set.to_owned(),
            other => panic!("{other:?}"),
        }
    }
    config
}

#[test]
fn the_papers_stages_can_be_trained() {
    let folder = tempfile::tempdir().unwrap();
    let (first, second) = (folder.path().join("first"), folder.path().join("second"));
    clips(&first.join("set"), &[9]);
    let (terms, validation) = trained(shipped(include_str!("../../configs/stage1.toml"), &first.join("set")), &first);
    assert_eq!(terms, [["decided_opacity", "photometric", "ssim"]; 2]);
    assert!(validation["network"].is_null() && validation["new_views_psnr"].is_number());
    dtu(&second.join("set"), 7);
    let (terms, validation) = trained(shipped(include_str!("../../configs/stage2.toml"), &second.join("set")), &second);
    assert_eq!(terms, [["alignment", "decided_opacity", "photometric", "range_depth", "rendered_depth", "ssim"]; 2]);
    assert!(validation["network"].is_object() && validation["new_views_psnr"].is_number());
}

#[test]
fn views_held_out_are_never_those_given() {
    let folder = tempfile::tempdir().unwrap();
    for (kind, rest) in [("re10k", "min_gap = 3\nmax_gap = 4\n"), ("dtu", ""), ("blended_mvs", "")] {
        let set = folder.path().join(kind);
        match kind {
            "re10k" => clips(&set, &[6]),
            "dtu" => dtu(&set, 5),
            _ => blended_mvs(&set, 5),
        }
        let config = config(&format!("num_targets = 2\nkind = \"{kind}\"\nfolder = {set:?}\n{rest}"));
        let sample = Source::open(&config.train[0].source, Split::Train, None).unwrap().sample(0).unwrap();
        assert_eq!((sample.num_views(), sample.targets.len()), (2, 2));
        let centres =
            || sample.cameras.iter().chain(sample.targets.iter().map(|target| &target.camera)).map(Camera::centre);
        let baseline = sample.cameras[0].centre().distance(sample.cameras[1].centre());
        for (i, centre) in centres().enumerate() {
            assert!(centres().skip(i + 1).all(|other| centre.distance(other) > 1e-3 * baseline), "{kind}");
        }
        assert!(sample.targets.iter().all(|target| target.truth.depth.is_some() == (kind != "re10k")));
    }
}

#[test]
fn dtu_and_blended_mvs_teach_measured_depth_and_nothing_of_its_holes() {
    for (kind, write) in [("dtu", dtu as fn(&Path, usize)), ("blended_mvs", blended_mvs)] {
        let folder = tempfile::tempdir().unwrap();
        write(&folder.path().join("set"), 5);
        let source = format!("kind = \"{kind}\"\nfolder = {:?}", folder.path().join("set"));
        let (terms, validation) = trained(config(&source), folder.path());
        assert_eq!(terms, [OF_MEASURED; 2]);
        let matching = &validation["matching"];
        // Matching an easy scene with the right cameras and range is right; with wrong ones it is not.
        assert!(matching["median_pct"].as_f64().unwrap() < 2.0, "{kind}: {matching}");
        assert!(matching["normal_deg"].is_null() && validation["matching_objects"].is_null(), "{validation}");
        assert!(folder.path().join("run/best.safetensors").exists());
    }
}

#[test]
fn a_number_is_a_sample() {
    let folder = tempfile::tempdir().unwrap();
    dtu(folder.path(), 5);
    let config = config(&format!("kind = \"dtu\"\nfolder = {:?}", folder.path()));
    let open = || Source::open(&config.train[0].source, Split::Train, None).unwrap();
    let source = open();
    let (first, second) = (source.sample(0).unwrap(), source.sample(1).unwrap());
    assert_eq!(
        (source.sample(0).unwrap().images, open().sample(1).unwrap().truth),
        (first.images.clone(), second.truth.clone())
    );
    assert_ne!(first.images, second.images);
    let holes = |y: usize| (0..64).filter(|x| first.truth[0].depth_at(64 * y + x) == 0.0).count();
    assert!(holes(2) == 64 && holes(46) < 3, "{} and {}", holes(2), holes(46));
    assert!(first.truth.iter().all(|view| view.normal.is_none() && view.object.is_none()));
    assert!(first.truth.iter().all(|view| !view.knows_surface_at(0) && view.knows_surface_at(64 * 46)));
}
