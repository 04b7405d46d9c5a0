//! COLMAP sparse models: `cameras`, `images` and `points3D`, binary or text (binary wins, as in COLMAP).
//!
//! `camera_from_world` as quaternion **w x y z** and translation, OpenCV axes, pixel centres at 0.5: our
//! own conventions. Ids are not indices; entries are sorted by image name.

mod binary;
mod camera;
mod text;

use crate::scene::entry::{Calibration, CameraFile, Entry};
use crate::scene::error::{Fault, SceneError, read_bytes};
use camera::ModelCamera;
use glam::{DQuat, DVec3};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use surfel_core::Rigid;

pub(super) use binary::{
    parse_cameras as binary_cameras, parse_images as binary_images, parse_points as binary_points,
};
pub(super) use text::{parse_cameras as text_cameras, parse_images as text_images, parse_points as text_points};

/// Cameras by id.
pub(super) type Cameras = BTreeMap<u32, ModelCamera>;

/// One registered photograph.
#[derive(Debug)]
pub(super) struct ModelImage {
    id: u32,
    camera_id: u32,
    name: String,
    camera_from_world: Rigid,
}

/// One sparse point and the ids of the images that see it.
#[derive(Debug)]
pub(super) struct ModelPoint {
    position: DVec3,
    image_ids: Vec<u32>,
}

/// True for a folder that holds a model.
pub(in crate::scene) fn is_model(folder: &Path) -> bool {
    variant(folder).is_some()
}

/// The extension of the model's files, binary preferred.
fn variant(folder: &Path) -> Option<&'static str> {
    let complete = |ext: &&str| ["cameras", "images"].iter().all(|file| folder.join(format!("{file}.{ext}")).is_file());
    ["bin", "txt"].into_iter().find(complete)
}

/// Bytes of the model's image list, a cheap stand-in for its number of images.
pub(in crate::scene) fn size_of_model(folder: &Path) -> u64 {
    let ext = variant(folder).unwrap_or("bin");
    std::fs::metadata(folder.join(format!("images.{ext}"))).map_or(0, |meta| meta.len())
}

pub(in crate::scene) fn read(folder: &Path) -> Result<CameraFile, SceneError> {
    let ext = variant(folder).unwrap_or("bin");
    let binary = ext == "bin";
    let file = |name: &str| folder.join(format!("{name}.{ext}"));
    fn load<T>(path: &Path, parse: impl Fn(&[u8]) -> Result<T, Fault>) -> Result<T, SceneError> {
        parse(&read_bytes(path)?).map_err(|fault| fault.in_file(path))
    }
    let (cameras, warnings) = load(&file("cameras"), if binary { binary_cameras } else { text_cameras })?;
    let images = load(&file("images"), if binary { binary_images } else { text_images })?;
    let points = match file("points3D") {
        path if path.is_file() => load(&path, if binary { binary_points } else { text_points })?,
        _ => Vec::new(),
    };
    let dialect = if binary { "COLMAP binary" } else { "COLMAP text" };
    let model = assemble(dialect, &cameras, images, points).map_err(|fault| fault.in_file(&file("images")))?;
    Ok(CameraFile { warnings, ..model })
}

fn assemble(
    dialect: &'static str,
    cameras: &Cameras,
    mut images: Vec<ModelImage>,
    points: Vec<ModelPoint>,
) -> Result<CameraFile, Fault> {
    images.sort_by(|a, b| a.name.cmp(&b.name));
    let index_of_id: HashMap<u32, u32> = images.iter().zip(0..).map(|(image, index)| (image.id, index)).collect();
    let entry = |image: ModelImage| {
        let missing = || {
            let known: Vec<String> = cameras.keys().take(8).map(u32::to_string).collect();
            let (name, id) = (&image.name, image.camera_id);
            Fault::text(format!("image {name} uses camera {id}, but the cameras file has {}", known.join(", ")))
        };
        let camera = cameras.get(&image.camera_id).ok_or_else(missing)?;
        let calibration = Calibration::Sized(camera.intrinsics, (camera.width, camera.height));
        Ok(Entry { lens: camera.lens, ..Entry::new(image.name, calibration, image.camera_from_world) })
    };
    let entries = images.into_iter().map(entry).collect::<Result<_, Fault>>()?;
    let seen = |point: ModelPoint| {
        let mut seen_by: Vec<u32> = point.image_ids.iter().filter_map(|id| index_of_id.get(id).copied()).collect();
        seen_by.sort_unstable();
        seen_by.dedup();
        (point.position, seen_by)
    };
    let points = points.into_iter().filter(|point| point.position.is_finite()).map(seen).collect();
    Ok(CameraFile { points, ..CameraFile::new(dialect, entries) })
}

/// A pose from COLMAP's seven numbers `qw qx qy qz tx ty tz`.
fn pose(name: &str, q: &[f64; 7]) -> Result<Rigid, Fault> {
    let rotation = DQuat::from_xyzw(q[1], q[2], q[3], q[0]);
    let translation = DVec3::new(q[4], q[5], q[6]);
    if rotation.is_finite() && rotation.length() < 1e-9 {
        return Err(Fault::text(format!("image {name} has a rotation quaternion of length zero")));
    }
    crate::scene::entry::rigid(name, glam::DMat3::from_quat(rotation.normalize()), translation)
}
