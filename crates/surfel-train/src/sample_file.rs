//! A sample as a file: safetensors with cameras, photographs in 8 bits, matching's answer, and the truth.
//!
//! Under `cache`. Invariant: what is read is what was written, damage is an error that names the file, and a file
//! appears whole or not at all.

use crate::error::TrainError;
use crate::sample::{Sample, Target};
use crate::truth::{Hole, TrueDepth, ViewTruth};
use glam::{DMat3, DVec3};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use surfel_core::{Camera, Grid, Intrinsics, Rigid};
use surfel_net::{DepthRange, Seed};

/// Values of a camera and of its range: size, intrinsics, rotation, translation, near, far, step (0 of views held out).
const CAMERA: usize = 2 + 4 + 9 + 3 + 2 + 1;
/// Values of a pixel of a seed: plane, evidence, correlation, confidence.
const SEED: usize = 7;
/// Values of a pixel of the truth: depth, normal, object.
const TRUTH: usize = 5;
/// Flags of a view: see [`known_values`].
const KNOWN: usize = 4;

/// The tensors of a file, view by view: those given to the network, which alone may have seeds, then those held out.
#[derive(Default)]
struct Columns {
    cameras: Vec<f64>,
    image: Vec<u8>,
    seed: Vec<f32>,
    truth: Vec<f32>,
    known: Vec<u8>,
}

impl Columns {
    fn add_view(&mut self, image: &Grid<[f32; 3]>, truth: &ViewTruth, camera: [f64; CAMERA]) {
        self.cameras.extend(camera);
        self.image.extend(image.as_slice().as_flattened().iter().map(|c| (255.0 * c).round() as u8));
        for i in 0..image.len() {
            let [x, y, z] = truth.normal_at(i).unwrap_or([0.0; 3]);
            self.truth.extend([truth.depth_at(i), x, y, z, if truth.is_object(i) { 1.0 } else { 0.0 }]);
        }
        self.known.extend(known_values(truth));
    }

    fn add_seed(&mut self, seed: &Seed) {
        for i in 0..seed.planes.len() {
            let [w, w_x, w_y] = seed.planes.as_slice()[i];
            let [at, weight] = seed.evidence.as_slice()[i];
            let (correlation, confidence) = (seed.correlation.as_slice()[i], seed.confidence.as_slice()[i]);
            self.seed.extend([w, w_x, w_y, at, weight, correlation, confidence]);
        }
    }
}

/// Writes a sample.
///
/// # Errors
/// When the file cannot be written.
pub(crate) fn write(sample: &Sample, path: &Path) -> Result<(), TrainError> {
    let mut columns = Columns::default();
    for (v, step) in sample.steps().into_iter().enumerate() {
        let camera = camera_values(&sample.cameras[v], &sample.ranges[v], step);
        columns.add_view(&sample.images[v], &sample.truth[v], camera);
    }
    sample.seeds.iter().for_each(|seed| columns.add_seed(seed));
    for target in &sample.targets {
        columns.add_view(&target.image, &target.truth, camera_values(&target.camera, &target.range, 0.0));
    }
    let Columns { cameras, image, seed, truth, known } = columns;
    let bytes = |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|value| value.to_le_bytes()).collect() };
    let cameras: Vec<u8> = cameras.iter().flat_map(|value| value.to_le_bytes()).collect();
    let (seed, truth) = (bytes(&seed), bytes(&truth));
    let damaged = |reason: String| TrainError::Damaged { path: path.to_path_buf(), reason };
    let ((width, height), views) = (sample.size(), sample.num_views() + sample.targets.len());
    let tensors = [
        ("cameras", TensorView::new(Dtype::F64, vec![views, CAMERA], &cameras)),
        ("image", TensorView::new(Dtype::U8, vec![views, height, width, 3], &image)),
        ("seed", TensorView::new(Dtype::F32, vec![sample.seeds.len(), height, width, SEED], &seed)),
        ("truth", TensorView::new(Dtype::F32, vec![views, height, width, TRUTH], &truth)),
        ("known", TensorView::new(Dtype::U8, vec![views, KNOWN], &known)),
    ];
    let tensors = tensors.into_iter().map(|(name, view)| view.map(|view| (name, view)));
    let tensors = tensors.collect::<Result<Vec<_>, _>>().map_err(|error| damaged(error.to_string()))?;
    let file = safetensors::serialize(tensors, None).map_err(|error| damaged(error.to_string()))?;
    // Processes that share a cache, and threads, may make the same sample at the same time.
    static WRITTEN: AtomicU64 = AtomicU64::new(0);
    let number = WRITTEN.fetch_add(1, Ordering::Relaxed);
    let beside = path.with_extension(format!("part{}-{number}", std::process::id()));
    std::fs::write(&beside, file).map_err(TrainError::unwritable(&beside))?;
    std::fs::rename(&beside, path).map_err(TrainError::unwritable(path))
}

/// Reads a sample.
///
/// # Errors
/// [`TrainError::Damaged`] for anything but what [`write`] writes.
pub(crate) fn read(path: &Path) -> Result<Sample, TrainError> {
    let bytes = std::fs::read(path).map_err(TrainError::unreadable(path))?;
    sample_of(&bytes).map_err(|reason| TrainError::Damaged { path: path.to_path_buf(), reason })
}

fn sample_of(bytes: &[u8]) -> Result<Sample, String> {
    let file = SafeTensors::deserialize(bytes).map_err(|error| error.to_string())?;
    let tensor = |name: &str| file.tensor(name).map_err(|error| error.to_string());
    let (cameras, image, seed, truth) = (tensor("cameras")?, tensor("image")?, tensor("seed")?, tensor("truth")?);
    let [views, height, width, 3] = *image.shape() else { return Err("the images have another layout".to_owned()) };
    let num_seeds = seed.shape().first().copied().unwrap_or_default();
    let expected = [
        (&cameras, Dtype::F64, vec![views, CAMERA]),
        (&image, Dtype::U8, vec![views, height, width, 3]),
        (&seed, Dtype::F32, vec![num_seeds, height, width, SEED]),
        (&truth, Dtype::F32, vec![views, height, width, TRUTH]),
    ];
    if expected.iter().any(|(found, dtype, shape)| found.dtype() != *dtype || found.shape() != shape) {
        return Err("its maps differ in size or hold other numbers".to_owned());
    }
    let known = match file.tensor("known") {
        Ok(known) if known.shape() == [views, KNOWN] => known.data().as_chunks::<KNOWN>().0.to_vec(),
        Ok(_) => return Err("what is known of its views has another layout".to_owned()),
        // Files from before real photographs were trained on hold rendered scenes.
        Err(_) => vec![[1; KNOWN]; views],
    };
    let cameras: Vec<f64> = cameras.data().as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
    let floats = |data: &[u8]| -> Vec<f32> { data.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect() };
    let (seed, truth) = (floats(seed.data()), floats(truth.data()));
    let (seed, truth) = (seed.as_chunks::<SEED>().0, truth.as_chunks::<TRUTH>().0);
    let colours = image.data().as_chunks::<3>().0;
    let mut sample = Sample::default();
    for v in 0..views {
        let pixels = v * width * height..(v + 1) * width * height;
        let (camera, range, step) = camera_from_values(&cameras[v * CAMERA..][..CAMERA]);
        let image = map(width, height, &colours[pixels.clone()], |rgb| rgb.map(|c| f32::from(c) / 255.0));
        let truth = truth_from_values(width, height, &truth[pixels.clone()], known[v]);
        if step == 0.0 {
            sample.targets.push(Target { image, camera, range, truth });
            continue;
        }
        sample.images.push(image);
        sample.cameras.push(camera);
        sample.ranges.push(range);
        if v < num_seeds {
            sample.seeds.push(seed_from_values(width, height, &seed[pixels], step));
        }
        sample.truth.push(truth);
    }
    match (sample.num_views(), num_seeds) {
        (0, _) => Err("it gives the network no view".to_owned()),
        (given, seeds) if seeds != given && seeds != 0 => Err(format!("it has {seeds} seeds for {given} views")),
        _ => Ok(sample),
    }
}

fn seed_from_values(width: usize, height: usize, values: &[[f32; SEED]], step: f32) -> Seed {
    Seed {
        planes: map(width, height, values, |s| [s[0], s[1], s[2]]),
        evidence: map(width, height, values, |s| [s[3], s[4]]),
        correlation: map(width, height, values, |s| s[5]),
        confidence: map(width, height, values, |s| s[6]),
        step,
    }
}

fn truth_from_values(width: usize, height: usize, values: &[[f32; TRUTH]], known: [u8; KNOWN]) -> ViewTruth {
    let [depth, empty, normal, object] = known.map(|flag| flag != 0);
    let hole = if empty { Hole::Empty } else { Hole::Unmeasured };
    ViewTruth {
        depth: depth.then(|| TrueDepth { map: map(width, height, values, |t| t[0]), hole }),
        normal: normal.then(|| map(width, height, values, |t| [t[1], t[2], t[3]])),
        object: object.then(|| map(width, height, values, |t| t[4] > 0.5)),
    }
}

/// Whether depth, where it ends, normals and objects are known.
fn known_values(truth: &ViewTruth) -> [u8; KNOWN] {
    let ends = truth.depth.as_ref().is_some_and(|depth| depth.hole == Hole::Empty);
    [truth.depth.is_some(), ends, truth.normal.is_some(), truth.object.is_some()].map(u8::from)
}

fn map<S, T>(width: usize, height: usize, values: &[S], value: impl Fn(&S) -> T) -> Grid<T> {
    Grid::from_vec(width, height, values.iter().map(value).collect())
}

fn camera_values(camera: &Camera, range: &DepthRange, step: f32) -> [f64; CAMERA] {
    let Intrinsics { fx, fy, cx, cy } = camera.intrinsics;
    let r = camera.camera_from_world.rotation.to_cols_array();
    let t = camera.camera_from_world.translation;
    let mut values = [0.0; CAMERA];
    values[..6].copy_from_slice(&[camera.width as f64, camera.height as f64, fx, fy, cx, cy]);
    values[6..15].copy_from_slice(&r);
    values[15..].copy_from_slice(&[t.x, t.y, t.z, range.near, range.far, f64::from(step)]);
    values
}

fn camera_from_values(values: &[f64]) -> (Camera, DepthRange, f32) {
    let rotation: [f64; 9] = std::array::from_fn(|i| values[6 + i]);
    let camera = Camera {
        intrinsics: Intrinsics { fx: values[2], fy: values[3], cx: values[4], cy: values[5] },
        width: values[0] as usize,
        height: values[1] as usize,
        camera_from_world: Rigid {
            rotation: DMat3::from_cols_array(&rotation),
            translation: DVec3::new(values[15], values[16], values[17]),
        },
    };
    (camera, DepthRange { near: values[18], far: values[19] }, values[20] as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::tests::{analytic, with_targets};

    #[test]
    fn what_is_not_known_stays_unknown_and_files_without_word_of_it_know_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sample.safetensors");
        let whole = analytic(3);
        let mut sample = whole.clone();
        sample.truth[0] = ViewTruth::default();
        sample.truth[1].normal = None;
        sample.truth[1].depth.as_mut().unwrap().hole = Hole::Unmeasured;
        write(&sample, &path).unwrap();
        assert_eq!(read(&path).unwrap().truth, sample.truth);

        write(&whole, &path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let old: Vec<_> = file.tensors().into_iter().filter(|(name, _)| name != "known").collect();
        assert_eq!(old.len(), 4);
        std::fs::write(&path, safetensors::serialize(old, None).unwrap()).unwrap();
        assert_eq!(read(&path).unwrap().truth, whole.truth);
    }

    #[test]
    fn views_held_out_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sample.safetensors");
        let sample = with_targets(3, 2);
        write(&sample, &path).unwrap();
        let back = read(&path).unwrap();
        assert_eq!((&back.targets, &back.images, &back.truth), (&sample.targets, &sample.images, &sample.truth));
        assert_eq!((back.seeds.len(), &back.cameras), (2, &sample.cameras));

        let unmatched = Sample { seeds: Vec::new(), ..sample };
        write(&unmatched, &path).unwrap();
        let back = read(&path).unwrap();
        assert_eq!((&back.targets, &back.images, back.seeds.len()), (&unmatched.targets, &unmatched.images, 0));
        assert_eq!(back.steps(), unmatched.steps());
    }
}
