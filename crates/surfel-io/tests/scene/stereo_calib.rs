//! Rectified pairs: `calib.txt` says little, and other programs' files of that name say something else.

use crate::written::{coordinates_picture, write};
use glam::DVec3;
use std::path::Path;
use surfel_core::{Intrinsics, Rigid};
use surfel_io::{FormatKind, Scene};

const CALIB: &str = "cam0=[120 0 46.25; 0 118.5 32.75; 0 0 1]\ncam1=[120 0 49.25; 0 118.5 32.75; 0 0 1]\ndoffs=3\n\
    baseline=193.001\nwidth=96\nheight=64\nndisp=28\nisint=0\nvmin=3\nvmax=25\ndyavg=0.9\ndymax=1.5\n";

fn scene(folder: &Path, calib: &str) {
    for name in ["im0.png", "im1.png"] {
        coordinates_picture(96, 64).save(folder.join(name)).unwrap();
    }
    write(folder, "calib.txt", calib);
}

#[test]
fn the_right_camera_stands_a_baseline_to_the_right() {
    let folder = tempfile::tempdir().unwrap();
    scene(folder.path(), CALIB);
    let scene = Scene::open(folder.path()).unwrap();
    assert_eq!((scene.format.kind, scene.frames.len()), (FormatKind::StereoCalib, 2));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let [left, right] = [0, 1].map(|i| scene.frames[i].pinhole());
    assert_eq!(left.camera_from_world, Rigid::IDENTITY);
    assert_eq!(right.centre(), DVec3::new(193.001, 0.0, 0.0));
    assert_eq!(left.intrinsics, Intrinsics { fx: 120.0, fy: 118.5, cx: 46.75, cy: 33.25 });
    assert_eq!(right.intrinsics, Intrinsics { cx: 49.75, ..left.intrinsics });
    assert_eq!(scene.frames[1].stem(), "im1");
}

#[test]
fn other_calib_files_are_not_taken_for_one_and_faults_name_line_and_key() {
    let folder = tempfile::tempdir().unwrap();
    scene(folder.path(), "P0: 7.070912e+02 0 6.018873e+02 0 0 7.070912e+02 1.831104e+02 0 0 0 1 0\n");
    let message = Scene::open(folder.path()).unwrap_err().to_string();
    assert!(message.contains("calib.txt with cam0"), "{message}");
    let faults = [
        (CALIB.replace("baseline=193.001", "baseline=-1"), "line 4: the baseline is -1"),
        (CALIB.replace("baseline=193.001\n", ""), "\"baseline\""),
        (CALIB.replace("cam1=[120 0 49.25;", "cam1=[120 49.25;"), "line 2: K needs 9 numbers, not 8"),
        (CALIB.replace("width=96", "width=x"), "line 5: \"x\""),
    ];
    for (calib, expected) in faults {
        write(folder.path(), "calib.txt", calib);
        let message = Scene::open(folder.path()).unwrap_err().to_string();
        assert!(message.contains(expected) && message.contains("calib.txt"), "{message}");
    }
}
