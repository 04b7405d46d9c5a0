//! DTU in the layout MVSNet trains on (spec 5.2): rectified photographs, quarter-size depth, cameras, pairs.
//!
//! ```text
//! Cameras/pair.txt                        Cameras/train/00000000_cam.txt      for 160 x 128 pixels, millimetres
//! Rectified/scan1_train/rect_001_3_r5000.png                                  640 x 512; names count from 1
//! Depths/scan1_train/depth_map_0000.pfm   Depths/scan1_train/depth_visual_0000.png
//! ```
//!
//! All of it was made from 1600 x 1200 pixels: halved, cropped to 640 x 512, and every fourth pixel of the depth kept.
//! Cameras were scaled along without half pixels, so a coordinate `u` of theirs is `u + 1/16` in continuous coordinates
//! of 160 x 128, for the principal point and for the places of the depth samples alike. Invariant: intrinsics are
//! divided by the size they are for, never by twice the principal point.

use crate::map_resample::{interpolated_depth, nearest};
use crate::pairs::PairList;
use crate::view_files::{depth_if_any, folders, mask_if_any};
use crate::{DataError, SceneViews, TrainingView};
use std::path::{Path, PathBuf};
use surfel_core::{Camera, Grid, Intrinsics};
use surfel_io::photo::read_picture;
use surfel_io::scene::{CamText, read_cam_text};

/// Millimetres per scene unit.
pub const UNIT_TO_WORLD: f64 = 200.0;
/// Nearest and farthest depth, millimetres.
const RANGE: (f64, f64) = (425.0, 905.0);
/// Size the cameras are for, pixels.
const CAMERA_SIZE: (usize, usize) = (160, 128);
/// Where their coordinate 0 lies in continuous coordinates of that size: half a pixel of 1600, an eighth the size.
const ORIGIN: f64 = 0.5 / 8.0;
/// Views of every scan.
const MAX_VIEWS: usize = 64;

/// The folder of the set.
#[derive(Clone, Debug)]
pub struct DtuSet {
    root: PathBuf,
    light: usize,
    pairs: PairList,
    cameras: Vec<CamText>,
}

impl DtuSet {
    /// Opens the set for photographs under light `light` (0 to 6; 3 is the usual one).
    ///
    /// # Errors
    /// [`DataError`] when a part of the layout is missing or damaged.
    pub fn open(root: &Path, light: usize) -> Result<Self, DataError> {
        let pairs = PairList::read(&root.join("Cameras/pair.txt"))?;
        let camera = |id: usize| root.join(format!("Cameras/train/{id:08}_cam.txt"));
        let present = (0..MAX_VIEWS).map(camera).take_while(|path| path.exists());
        let cameras = present.map(|path| read_cam_text(&path)).collect::<Result<Vec<_>, _>>()?;
        if cameras.is_empty() {
            return Err(DataError::malformed(
                root,
                "holds no Cameras/train/00000000_cam.txt; is this DTU as MVSNet trains on it?",
            ));
        }
        Ok(Self { root: root.to_owned(), light, pairs, cameras })
    }

    /// The scans whose photographs are there, ascending.
    ///
    /// # Errors
    /// [`DataError`] when there is no folder `Rectified`.
    pub fn scans(&self) -> Result<Vec<u32>, DataError> {
        let number = |name: &str| name.strip_prefix("scan")?.strip_suffix("_train")?.parse().ok();
        let mut scans: Vec<u32> =
            folders(&self.root.join("Rectified"), number)?.into_iter().map(|(scan, _)| scan).collect();
        scans.sort_unstable();
        Ok(scans)
    }

    /// One scan.
    ///
    /// # Errors
    /// [`DataError`] when its photographs are not there.
    pub fn scan(&self, scan: u32) -> Result<DtuScan<'_>, DataError> {
        let name = format!("scan{scan}");
        let folder = self.root.join(format!("Rectified/{name}_train"));
        if !folder.is_dir() {
            return Err(DataError::malformed(
                &self.root,
                format!("holds no photographs of {name} (Rectified/{name}_train)"),
            ));
        }
        Ok(DtuScan { set: self, name })
    }
}

/// One scan, lengths in units of 200 mm.
#[derive(Clone, Debug)]
pub struct DtuScan<'a> {
    set: &'a DtuSet,
    name: String,
}

impl SceneViews for DtuScan<'_> {
    fn name(&self) -> &str {
        &self.name
    }

    fn num_views(&self) -> usize {
        self.set.cameras.len()
    }

    fn range(&self) -> (f64, f64) {
        (RANGE.0 / UNIT_TO_WORLD, RANGE.1 / UNIT_TO_WORLD)
    }

    fn unit_to_world(&self) -> f64 {
        UNIT_TO_WORLD
    }

    fn pairs(&self) -> Option<&PairList> {
        Some(&self.set.pairs)
    }

    fn view(&mut self, index: usize) -> Result<TrainingView, DataError> {
        let (root, name) = (&self.set.root, &self.name);
        let path = root.join(format!("Rectified/{name}_train/rect_{:03}_{}_r5000.png", index + 1, self.set.light));
        let image = read_picture(&path)?;
        let (width, height) = (image.width(), image.height());
        check_shape(&path, width, height)?;
        let camera = camera(&self.set.cameras[index], width, height);
        let depths = root.join(format!("Depths/{name}_train"));
        let path = depths.join(format!("depth_map_{index:04}.pfm"));
        let depth = depth_if_any(&path)?;
        depth.iter().try_for_each(|map| check_shape(&path, map.width(), map.height()))?;
        let path = depths.join(format!("depth_visual_{index:04}.png"));
        let mask = mask_if_any(&path)?;
        mask.iter().try_for_each(|map| check_shape(&path, map.width(), map.height()))?;
        Ok(TrainingView {
            name: format!("{name} {index}"),
            depth: depth.map(|map| depth_of_image(&map, width, height)),
            mask: mask.map(|map| nearest(&map, width, height)),
            normal: None,
            image,
            camera,
        })
    }
}

/// Every picture of the set has the shape of 160 x 128.
fn check_shape(path: &Path, width: usize, height: usize) -> Result<(), DataError> {
    if width > 0 && width * CAMERA_SIZE.1 == height * CAMERA_SIZE.0 {
        return Ok(());
    }
    let reason = format!("has {width}x{height} pixels, which is no multiple of the 160x128 that the cameras are for");
    Err(DataError::malformed(path, reason))
}

/// The camera of the photograph, in scene units.
fn camera(file: &CamText, width: usize, height: usize) -> Camera {
    let [fx, fy, cx, cy] = file.intrinsics;
    let intrinsics = Intrinsics { fx, fy, cx: cx + ORIGIN, cy: cy + ORIGIN };
    let mut camera_from_world = file.camera_from_world;
    camera_from_world.translation /= UNIT_TO_WORLD;
    let camera = Camera { intrinsics, width: CAMERA_SIZE.0, height: CAMERA_SIZE.1, camera_from_world };
    camera.resized(width, height)
}

/// Millimetres at every stored pixel to scene units at every pixel of the photograph.
fn depth_of_image(map: &Grid<f32>, width: usize, height: usize) -> Grid<f32> {
    let map = map.map(|z| z / UNIT_TO_WORLD as f32);
    // Columns and rows alike are measured in pixels of 160 x 128 in between.
    let unit = map.width() as f64 / CAMERA_SIZE.0 as f64;
    let factor = width as f64 / CAMERA_SIZE.0 as f64;
    interpolated_depth(&map, (width, height), |i, _, _| ((i as f64 + 0.5) / factor - ORIGIN) * unit)
}
