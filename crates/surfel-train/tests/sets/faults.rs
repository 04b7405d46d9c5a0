//! What is missing is named, with what to do about it.

use crate::layouts::{blended_mvs, clips, dtu};
use crate::training::config;
use std::path::Path;
use surfel_synth::Split;
use surfel_train::source::Source;

/// Why a source cannot be opened, or gives no sample.
fn fault(source: &str, split: Split) -> String {
    let config = config(source);
    let opened = Source::open(&config.train[0].source, split, None);
    match opened.and_then(|source| source.sample(0)) {
        Ok(_) => panic!("{source} gives samples"),
        Err(error) => error.to_string(),
    }
}

fn assert_says(text: &str, words: &[&str]) {
    words.iter().for_each(|words| assert!(text.contains(words), "{words:?} is not in: {text}"));
}

#[test]
fn a_folder_that_is_missing_or_empty_is_named_with_what_it_should_be() {
    let folder = tempfile::tempdir().unwrap();
    for path in [folder.path().join("nowhere"), folder.path().to_owned()] {
        let of_kind =
            |kind: &str, rest: &str| fault(&format!("kind = \"{kind}\"\nfolder = {path:?}\n{rest}"), Split::Train);
        let named = path.to_str().unwrap();
        for kind in ["re10k", "acid"] {
            let said = of_kind(kind, "min_gap = 1\nmax_gap = 2");
            assert_says(&said, &[named, "index.json", &format!("`folder` of a source of kind {kind}")]);
        }
        assert_says(&of_kind("dtu", ""), &[named, "pair.txt", "Cameras, Rectified and Depths"]);
        assert_says(&of_kind("blended_mvs", ""), &[named, "the folder of scenes, each a folder with blended_images"]);
    }
}

#[test]
fn scenes_with_too_few_views_are_named_with_what_to_lower() {
    let folder = tempfile::tempdir().unwrap();
    let written = |write: &dyn Fn(&Path), name: &str| {
        let path = folder.path().join(name);
        write(&path);
        format!("folder = {path:?}")
    };
    let set = written(&|path| clips(path, &[3]), "clips");
    let said = fault(&format!("kind = \"re10k\"\n{set}\nmin_gap = 5\nmax_gap = 9"), Split::Train);
    assert_says(&said, &["clips", "clip0 has 3 frames", "a gap of 5", "lower min_gap"]);
    let set = written(&|path| dtu(path, 1), "dtu");
    assert_says(&fault(&format!("kind = \"dtu\"\n{set}"), Split::Train), &["scan1", "pair.txt", "lower num_views"]);
    let set = written(&|path| blended_mvs(path, 1), "blended");
    let said = fault(&format!("kind = \"blended_mvs\"\n{set}\nlist = \"list.txt\""), Split::Train);
    assert_says(&said, &["no view of a has", "pair.txt"]);
    let said = fault(&format!("kind = \"blended_mvs\"\n{set}\nlist = \"none.txt\""), Split::Train);
    assert_says(&said, &["none.txt"]);
}

#[test]
fn scans_that_results_are_stated_on_are_never_used() {
    let folder = tempfile::tempdir().unwrap();
    dtu(folder.path(), 3);
    let rectified = folder.path().join("Rectified");
    ["scan1_train", "scan2_train"].iter().for_each(|scan| std::fs::remove_dir_all(rectified.join(scan)).unwrap());
    let source = format!("kind = \"dtu\"\nfolder = {:?}", folder.path());
    assert_says(&fault(&source, Split::Train), &["no scan that is trained on", "scan1_train"]);
    assert_says(&fault(&source, Split::Val), &["neither trained nor tested on", "scan2_train"]);
}
