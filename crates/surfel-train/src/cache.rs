//! Samples kept on disk, so that a second epoch costs no rendering and no matching.
//!
//! One safetensors file per sample in a folder named by the source's settings. Invariant: a cached sample is the
//! one that would be made again; damage is an error that names
//! the file, and a file appears whole or not at all.

use crate::error::TrainError;
use crate::sample::Sample;
use crate::source::{Source, SourceConfig};
use glam::{DMat3, DVec3};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::path::{Path, PathBuf};
use surfel_core::{Camera, Grid, Intrinsics, Rigid};
use surfel_net::{DepthRange, Seed};

/// A folder of samples in front of a source.
pub struct Cache {
    folder: Option<PathBuf>,
    source: Source,
}

/// Values of a camera and of its range: size, intrinsics, rotation, translation, near, far, step.
const CAMERA: usize = 2 + 4 + 9 + 3 + 2 + 1;
/// Values of a pixel of a seed: plane, evidence, correlation, confidence.
const SEED: usize = 7;

impl Cache {
    /// In front of `source`; without a folder nothing is kept.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn new(source: Source, config: &SourceConfig, folder: Option<&Path>, side: &str) -> Result<Self, TrainError> {
        let folder = folder.map(|folder| folder.join(config.folder_name(side)));
        if let Some(folder) = &folder {
            std::fs::create_dir_all(folder).map_err(TrainError::unwritable(folder))?;
        }
        Ok(Self { folder, source })
    }

    /// The sample with a number, from disk or made now.
    ///
    /// # Errors
    /// When it cannot be made, or its file is damaged.
    pub fn sample(&self, number: u64) -> Result<Sample, TrainError> {
        let Some(folder) = &self.folder else { return self.source.sample(number) };
        let path = folder.join(format!("{number:07}.safetensors"));
        if !path.is_file() {
            write(&self.source.sample(number)?, &path)?;
        }
        let bytes = std::fs::read(&path).map_err(TrainError::unreadable(&path))?;
        read(&bytes).map_err(|reason| TrainError::Damaged { path, reason })
    }
}

fn write(sample: &Sample, path: &Path) -> Result<(), TrainError> {
    let (width, height) = sample.size();
    let views = sample.num_views();
    let (mut cameras, mut image, mut seed, mut truth) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for v in 0..views {
        cameras.extend(camera_values(&sample.cameras[v], &sample.ranges[v], sample.seeds[v].step));
        image.extend(sample.images[v].as_slice().as_flattened().iter().map(|c| (255.0 * c).round() as u8));
        for i in 0..width * height {
            let known = &sample.seeds[v];
            let [w, w_x, w_y] = known.planes.as_slice()[i];
            let [at, weight] = known.evidence.as_slice()[i];
            seed.extend([w, w_x, w_y, at, weight, known.correlation.as_slice()[i], known.confidence.as_slice()[i]]);
            let [x, y, z] = sample.normal[v].as_slice()[i];
            let object = if sample.object[v].as_slice()[i] { 1.0 } else { 0.0 };
            truth.extend([sample.depth[v].as_slice()[i], x, y, z, object]);
        }
    }
    let bytes = |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|value| value.to_le_bytes()).collect() };
    let cameras: Vec<u8> = cameras.iter().flat_map(|value| value.to_le_bytes()).collect();
    let (seed, truth) = (bytes(&seed), bytes(&truth));
    let damaged = |reason: String| TrainError::Damaged { path: path.to_path_buf(), reason };
    let tensor = |dtype, channels: usize, data| TensorView::new(dtype, vec![views, height, width, channels], data);
    let tensors = [
        ("cameras", TensorView::new(Dtype::F64, vec![views, CAMERA], &cameras)),
        ("image", tensor(Dtype::U8, 3, image.as_slice())),
        ("seed", tensor(Dtype::F32, SEED, &seed)),
        ("truth", tensor(Dtype::F32, 5, &truth)),
    ];
    let tensors = tensors.into_iter().map(|(name, view)| view.map(|view| (name, view)));
    let tensors = tensors.collect::<Result<Vec<_>, _>>().map_err(|error| damaged(error.to_string()))?;
    let file = safetensors::serialize(tensors, None).map_err(|error| damaged(error.to_string()))?;
    let beside = path.with_extension(format!("part{}", std::process::id()));
    std::fs::write(&beside, file).map_err(TrainError::unwritable(&beside))?;
    std::fs::rename(&beside, path).map_err(TrainError::unwritable(path))
}

fn read(bytes: &[u8]) -> Result<Sample, String> {
    let file = SafeTensors::deserialize(bytes).map_err(|error| error.to_string())?;
    let tensor = |name: &str| file.tensor(name).map_err(|error| error.to_string());
    let (cameras, image, seed, truth) = (tensor("cameras")?, tensor("image")?, tensor("seed")?, tensor("truth")?);
    let [views, height, width, 3] = *image.shape() else { return Err("the images have another layout".to_owned()) };
    let shapes = [(cameras.shape(), vec![views, CAMERA]), (seed.shape(), vec![views, height, width, SEED])];
    if shapes.iter().any(|(found, expected)| found != expected) || truth.shape() != [views, height, width, 5] {
        return Err("its maps differ in size".to_owned());
    }
    let cameras: Vec<f64> = cameras.data().as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
    let floats = |data: &[u8]| -> Vec<f32> { data.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect() };
    let (seed, truth) = (floats(seed.data()), floats(truth.data()));
    let (seed, truth) = (seed.as_chunks::<SEED>().0, truth.as_chunks::<5>().0);
    let colours = image.data().as_chunks::<3>().0;
    let pixels = width * height;
    let mut sample = Sample {
        images: Vec::new(),
        cameras: Vec::new(),
        ranges: Vec::new(),
        seeds: Vec::new(),
        depth: Vec::new(),
        normal: Vec::new(),
        object: Vec::new(),
    };
    for v in 0..views {
        let (camera, range, step) = camera_from_values(&cameras[v * CAMERA..][..CAMERA]);
        let (seed, truth) = (&seed[v * pixels..][..pixels], &truth[v * pixels..][..pixels]);
        let colours = &colours[v * pixels..][..pixels];
        sample.images.push(map(width, height, colours, |rgb| rgb.map(|c| f32::from(c) / 255.0)));
        sample.seeds.push(Seed {
            planes: map(width, height, seed, |s| [s[0], s[1], s[2]]),
            evidence: map(width, height, seed, |s| [s[3], s[4]]),
            correlation: map(width, height, seed, |s| s[5]),
            confidence: map(width, height, seed, |s| s[6]),
            step,
        });
        sample.depth.push(map(width, height, truth, |t| t[0]));
        sample.normal.push(map(width, height, truth, |t| [t[1], t[2], t[3]]));
        sample.object.push(map(width, height, truth, |t| t[4] > 0.5));
        sample.cameras.push(camera);
        sample.ranges.push(range);
    }
    Ok(sample)
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
    use crate::source::SourceKind;
    use surfel_synth::Split;

    #[test]
    fn a_cached_sample_is_the_sample() {
        let kind = SourceKind::Analytic;
        let (pair_angle_deg, defects, sharpening) = ([6.0, 20.0], 1.0, [0.0, 0.0]);
        let (seed, width, height, num_views, room_share) = (3, 48, 32, 2, 0.0);
        let config =
            SourceConfig { kind, seed, width, height, num_views, room_share, pair_angle_deg, defects, sharpening };
        let open = || Source::open(&config, Split::Train, None).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(open(), &config, Some(folder.path()), "train").unwrap();
        let (fresh, first, second) = (open().sample(5).unwrap(), cache.sample(5).unwrap(), cache.sample(5).unwrap());
        for cached in [&first, &second] {
            assert_eq!(cached.cameras, fresh.cameras);
            assert_eq!(cached.depth, fresh.depth);
            assert_eq!(cached.normal, fresh.normal);
            assert_eq!(cached.seeds[1].planes, fresh.seeds[1].planes);
            assert_eq!(cached.seeds[1].step, fresh.seeds[1].step);
            assert_eq!(cached.images, fresh.images);
        }
        let path = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        let file = std::fs::read_dir(path).unwrap().next().unwrap().unwrap().path();
        let bytes = std::fs::read(&file).unwrap();
        std::fs::write(&file, &bytes[..bytes.len() / 2]).unwrap();
        assert!(cache.sample(5).unwrap_err().to_string().contains("is damaged"));
    }
}
