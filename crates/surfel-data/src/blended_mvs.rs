//! BlendedMVS (spec 5.4): a folder per scene with blended photographs, cameras, pairs and rendered depth.
//!
//! ```text
//! <scene>/blended_images/00000000.jpg     <scene>/cams/00000000_cam.txt     <scene>/cams/pair.txt
//! <scene>/rendered_depth_maps/00000000.pfm
//! ```
//!
//! The unit of every scene is its own, so each is scaled until its nearest depth is that of DTU. Invariant: ranges in
//! camera files that are empty or negative, which the set has, are not used.

use crate::map_resample::depth_at_size;
use crate::pairs::PairList;
use crate::view_files::{depth_if_any, folders};
use crate::{DataError, SceneViews, TrainingView};
use std::path::{Path, PathBuf};
use surfel_core::{Camera, Intrinsics};
use surfel_io::photo::read_picture;
use surfel_io::scene::{CamText, read_cam_text};

/// Nearest depth of every scene, scene units.
const NEAR: f64 = 2.125;

/// The folder of the set.
#[derive(Clone, Debug)]
pub struct BlendedMvsSet {
    scenes: Vec<(String, PathBuf)>,
}

impl BlendedMvsSet {
    /// Finds the scenes.
    ///
    /// # Errors
    /// [`DataError`] when the folder cannot be read or holds none.
    pub fn open(root: &Path) -> Result<Self, DataError> {
        let mut scenes = folders(root, |name| Some(name.to_owned()))?;
        scenes.retain(|(_, path)| path.join("blended_images").is_dir() && path.join("cams").is_dir());
        if scenes.is_empty() {
            return Err(DataError::malformed(
                root,
                "holds no scene with folders blended_images and cams; is this BlendedMVS?",
            ));
        }
        Ok(Self { scenes })
    }

    /// Names of the scenes, sorted.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.scenes.iter().map(|(name, _)| name.as_str())
    }

    /// Opens one scene: reads its cameras and pairs.
    ///
    /// # Errors
    /// [`DataError`] when it is not there, or a camera is damaged.
    pub fn scene(&self, name: &str) -> Result<BlendedMvsScene, DataError> {
        let found = self.scenes.iter().find(|(scene, _)| scene == name);
        let (_, root) = found.ok_or_else(|| DataError::malformed(name, "is no scene of this BlendedMVS folder"))?;
        let pairs = PairList::read(&root.join("cams/pair.txt"))?;
        let camera = |id: usize| root.join(format!("cams/{id:08}_cam.txt"));
        let mut cameras = Vec::new();
        while camera(cameras.len()).exists() {
            cameras.push(read_cam_text(&camera(cameras.len()))?);
        }
        let ranges = || cameras.iter().filter_map(|camera| camera.depth_range);
        let near = ranges().map(|(near, _)| near).fold(f64::INFINITY, f64::min);
        let far = ranges().map(|(_, far)| far).fold(0.0, f64::max);
        if !near.is_finite() {
            let reason =
                format!("none of its {} camera files states a depth range above 0; leave the scene out", cameras.len());
            return Err(DataError::malformed(root.join("cams"), reason));
        }
        let unit_to_world = near / NEAR;
        let range = (NEAR, far / unit_to_world);
        Ok(BlendedMvsScene { name: name.to_owned(), root: root.clone(), pairs, cameras, range, unit_to_world })
    }
}

/// One scene, scaled.
#[derive(Clone, Debug)]
pub struct BlendedMvsScene {
    name: String,
    root: PathBuf,
    pairs: PairList,
    cameras: Vec<CamText>,
    range: (f64, f64),
    unit_to_world: f64,
}

impl SceneViews for BlendedMvsScene {
    fn name(&self) -> &str {
        &self.name
    }

    fn num_views(&self) -> usize {
        self.cameras.len()
    }

    fn range(&self) -> (f64, f64) {
        self.range
    }

    fn unit_to_world(&self) -> f64 {
        self.unit_to_world
    }

    fn pairs(&self) -> Option<&PairList> {
        Some(&self.pairs)
    }

    fn view(&mut self, index: usize) -> Result<TrainingView, DataError> {
        let path = self.root.join(format!("blended_images/{index:08}.jpg"));
        let image = read_picture(&path)?;
        let (width, height) = (image.width(), image.height());
        let CamText { camera_from_world, intrinsics: [fx, fy, cx, cy], .. } = self.cameras[index];
        let intrinsics = Intrinsics::from_index_coordinates(fx, fy, cx, cy);
        let near_middle = |centre: f64, length: usize| (0.25..0.75).contains(&(centre / length as f64));
        if !near_middle(intrinsics.cx, width) || !near_middle(intrinsics.cy, height) {
            let reason = format!(
                "has {width}x{height} pixels, but its camera is for about {:.0}x{:.0}; use images and cameras of one resolution",
                2.0 * intrinsics.cx,
                2.0 * intrinsics.cy
            );
            return Err(DataError::malformed(path, reason));
        }
        let mut camera = Camera { intrinsics, width, height, camera_from_world };
        camera.camera_from_world.translation /= self.unit_to_world;
        let path = self.root.join(format!("rendered_depth_maps/{index:08}.pfm"));
        let depth = depth_if_any(&path)?.map(|map| map.map(|z| z / self.unit_to_world as f32));
        if let Some(map) = &depth
            && map.width() * height != map.height() * width
        {
            let reason = format!("has {}x{} pixels, another shape than its photograph", map.width(), map.height());
            return Err(DataError::malformed(path, reason));
        }
        Ok(TrainingView {
            name: format!("{} {index}", self.name),
            depth: depth.map(|map| depth_at_size(&map, width, height)),
            normal: None,
            mask: None,
            image,
            camera,
        })
    }
}
