//! Finds what a scene can be scored against: reference depth and points beside its photographs.
//!
//! Layouts: `pseudo_gt/` with `meta.json`, `depth_*.png` and `points.npz`; `depth/*.pfm` and `truth/points.ply` (exact,
//! as synthetic scenes are written); `depth/*.png` in millimetres (sensors); `disp0.pfm` or `disp0GT.pfm` beside a
//! `calib.txt` (rectified pairs); a mesh, `truth/mesh.ply` or `pseudo_gt_mesh.ply`, whose depth is that of its first
//! face. Invariant: everything comes out in scene units and OpenCV axes, maps on the raster they were stored in.

use crate::first_hit::mesh_depth;
use std::path::{Path, PathBuf};
use surfel_core::{Camera, Grid, Intrinsics};
use surfel_io::depth::{read_depth_png16, read_pfm};
use surfel_io::npy::{NpyError, Npz};
use surfel_io::photo::ImageError;
use surfel_io::ply::{PlyFileError, read_ply_file};
use surfel_io::{FormatKind, Scene, SceneError};

/// Reference points of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions, scene units, world frame.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals, outward, world frame, or empty.
    pub normals: Vec<[f32; 3]>,
}

/// Why a reference that is there cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ReferenceError {
    /// A depth map does not read.
    #[error(transparent)]
    Depth(#[from] ImageError),
    /// The points do not read.
    #[error(transparent)]
    Points(#[from] NpyError),
    /// The exact points or the mesh do not read.
    #[error(transparent)]
    ExactPoints(#[from] PlyFileError),
    /// The cameras of a rectified pair do not read.
    #[error(transparent)]
    Cameras(#[from] SceneError),
    /// `meta.json` or the points lack something.
    #[error("{path}: {problem}")]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
}

/// The reference of one scene; files are read when asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    scene: PathBuf,
    layout: Layout,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Layout {
    /// `pseudo_gt/depth_NN.png` counting in `unit` scene units.
    MultiView { unit: f64 },
    /// `depth/STEM.pfm`, scene units.
    Exact,
    /// `depth/STEM.png`, millimetres in a scene in metres.
    Sensor,
    /// `disp0.pfm` or `disp0GT.pfm`, pixels between the left and the right camera.
    Disparity(Rectified),
    /// A mesh in the world, one of [`MESHES`].
    Mesh,
}

/// A rectified pair, in pixels of photographs of a stated width.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Rectified {
    /// Baseline times focal length, scene units x pixels.
    baseline_focal: f64,
    /// How much farther right the right principal point lies, pixels.
    offset: f64,
    /// Columns of the photographs.
    width: usize,
}

/// Where a mesh to compare with may lie.
const MESHES: [&str; 2] = ["truth/mesh.ply", "pseudo_gt_mesh.ply"];
/// What the files of disparities are named after the number of the photograph: Middlebury and ETH3D.
const DISPARITIES: [&str; 2] = ["", "GT"];

/// Millimetres to metres.
const SENSOR_UNIT: f64 = 0.001;

impl Reference {
    /// Looks for a reference in a scene folder; `None` when there is none.
    ///
    /// # Errors
    /// [`ReferenceError`] when there is one and it does not say its unit, or its cameras do not read.
    pub fn open(scene: &Path) -> Result<Option<Self>, ReferenceError> {
        let meta = scene.join("pseudo_gt/meta.json");
        let has = |extension: &str| files_of(&scene.join("depth"), extension).next().is_some();
        let layout = if meta.is_file() {
            Layout::MultiView { unit: unit_of(&meta)? }
        } else if has("pfm") {
            Layout::Exact
        } else if has("png") {
            Layout::Sensor
        } else if let Some(pair) = rectified_pair(scene)? {
            Layout::Disparity(pair)
        } else if mesh_of(scene).is_some() {
            Layout::Mesh
        } else {
            return Ok(None);
        };
        Ok(Some(Self { scene: scene.to_owned(), layout }))
    }

    /// Reference depth (scene units, 0 = none) of the photograph `stem` and the intrinsics of its raster; `camera` is
    /// that of the photograph at any size. `None` when that photograph has no reference.
    ///
    /// # Errors
    /// [`ReferenceError`] when the depth map is there and does not read.
    pub fn depth_of(&self, stem: &str, camera: &Camera) -> Result<Option<(Grid<f32>, Intrinsics)>, ReferenceError> {
        let path = match self.layout {
            Layout::MultiView { .. } => find(&self.scene.join("pseudo_gt"), "depth_", stem, "png"),
            Layout::Exact => find(&self.scene.join("depth"), "", stem, "pfm"),
            Layout::Sensor => find(&self.scene.join("depth"), "", stem, "png"),
            Layout::Disparity(_) => disparities_of(&self.scene, stem),
            Layout::Mesh => mesh_of(&self.scene),
        };
        let Some(path) = path else { return Ok(None) };
        let depth = match self.layout {
            Layout::MultiView { unit } => read_depth_png16(&path, unit)?,
            Layout::Exact => read_pfm(&path)?,
            Layout::Sensor => read_depth_png16(&path, SENSOR_UNIT)?,
            Layout::Disparity(pair) => pair.depth(&read_pfm(&path)?),
            Layout::Mesh => mesh_depth(&read_ply_file(&path)?, camera),
        };
        // All layouts store the full field of view, so the photograph's camera at their size is theirs.
        let intrinsics = camera.resized(depth.width(), depth.height()).intrinsics;
        Ok(Some((depth, intrinsics)))
    }

    /// Reference points in the world, scene units; `None` when the layout has none.
    ///
    /// # Errors
    /// [`ReferenceError`] when they are there and do not read.
    pub fn points(&self) -> Result<Option<PointCloud>, ReferenceError> {
        let exact = self.scene.join("truth/points.ply");
        if self.layout == Layout::Exact && exact.is_file() {
            let mesh = read_ply_file(&exact)?;
            return Ok(Some(PointCloud { positions: mesh.positions, normals: mesh.normals }));
        }
        let path = self.scene.join("pseudo_gt/points.npz");
        if !path.is_file() {
            return Ok(None);
        }
        let mut archive = Npz::open(&path)?;
        let (counts, unit, offset) = (archive.array("p")?, archive.array("unit")?, archive.array("offset")?);
        let normals = if archive.names().iter().any(|name| name == "n") { Some(archive.array("n")?) } else { None };
        let malformed = |problem: &str| ReferenceError::Malformed { path: path.clone(), problem: problem.to_owned() };
        let (&[unit], &[x, y, z]) = (&unit.data[..], &offset.data[..]) else {
            return Err(malformed("`unit` must be one number and `offset` three"));
        };
        if counts.shape.len() != 2 || counts.shape[1] != 3 {
            return Err(malformed("`p` must be an N x 3 array"));
        }
        let offset = [x, y, z];
        let position = |p: &[f64]| std::array::from_fn(|i| (p[i] * unit + offset[i]) as f32);
        let positions: Vec<[f32; 3]> = counts.data.chunks_exact(3).map(position).collect();
        let unit_normal =
            |n: &[f64]| glam::DVec3::new(n[0], n[1], n[2]).normalize_or(glam::DVec3::Z).as_vec3().to_array();
        let normals: Vec<[f32; 3]> =
            normals.map_or_else(Vec::new, |normals| normals.data.chunks_exact(3).map(unit_normal).collect());
        if !normals.is_empty() && normals.len() != positions.len() {
            return Err(malformed("`n` must be as long as `p`"));
        }
        Ok(Some(PointCloud { positions, normals }))
    }
}

/// Scene units per count of `meta.json`: `depth_unit_mm` in a scene in millimetres, `depth_unit_m` in one in metres.
fn unit_of(meta: &Path) -> Result<f64, ReferenceError> {
    let malformed = |problem: String| ReferenceError::Malformed { path: meta.to_owned(), problem };
    let text = std::fs::read_to_string(meta).map_err(|error| malformed(error.to_string()))?;
    let json: serde_json::Value = serde_json::from_str(&text).map_err(|error| malformed(error.to_string()))?;
    let unit = ["depth_unit_mm", "depth_unit_m"].iter().find_map(|key| json[key].as_f64());
    unit.filter(|unit| *unit > 0.0).ok_or_else(|| malformed("needs `depth_unit_mm` or `depth_unit_m`".into()))
}

fn mesh_of(scene: &Path) -> Option<PathBuf> {
    MESHES.iter().map(|name| scene.join(name)).find(|path| path.is_file())
}

/// The rectified pair of a scene whose disparity is known; disparities without a `calib.txt` are no reference.
fn rectified_pair(scene: &Path) -> Result<Option<Rectified>, ReferenceError> {
    if disparities_of(scene, "im0").is_none() || !scene.join("calib.txt").is_file() {
        return Ok(None);
    }
    let pair = Scene::open_as(scene, FormatKind::StereoCalib)?;
    let [left, right] = [0, 1].map(|side| pair.frames[side].pinhole());
    Ok(Some(Rectified {
        baseline_focal: (right.centre() - left.centre()).length() * left.intrinsics.fx,
        offset: right.intrinsics.cx - left.intrinsics.cx,
        width: left.width,
    }))
}

/// The disparities of `im0` or `im1`.
fn disparities_of(scene: &Path, stem: &str) -> Option<PathBuf> {
    let number = stem.strip_prefix("im").filter(|number| ["0", "1"].contains(number))?;
    DISPARITIES.iter().map(|end| scene.join(format!("disp{number}{end}.pfm"))).find(|path| path.is_file())
}

impl Rectified {
    /// `Z = baseline f / (d + offset)`; 0 where the disparity is 0, as [`read_pfm`] gives it where it is not known.
    /// `disparity` may have another size than the photographs.
    fn depth(&self, disparity: &Grid<f32>) -> Grid<f32> {
        let scale = disparity.width() as f64 / self.width as f64;
        disparity.map(|&d| {
            let parallax = f64::from(d) + scale * self.offset;
            if d > 0.0 && parallax > 0.0 { (scale * self.baseline_focal / parallax) as f32 } else { 0.0 }
        })
    }
}

/// The file `prefix + stem + extension`; a stem that is a number also finds it with other leading zeros.
fn find(folder: &Path, prefix: &str, stem: &str, extension: &str) -> Option<PathBuf> {
    let exact = folder.join(format!("{prefix}{stem}.{extension}"));
    if exact.is_file() {
        return Some(exact);
    }
    let number: u64 = stem.parse().ok()?;
    files_of(folder, extension).find(|path| {
        let name = path.file_stem().and_then(|name| name.to_str()).and_then(|name| name.strip_prefix(prefix));
        name.and_then(|name| name.parse().ok()) == Some(number)
    })
}

fn files_of(folder: &Path, extension: &str) -> impl Iterator<Item = PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    entries.filter(move |path| path.extension().is_some_and(|found| found == extension))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use surfel_core::Rigid;
    use surfel_io::write::{depth_png::write_depth_png, pfm::write_pfm};

    fn camera() -> Camera {
        let intrinsics = Intrinsics { fx: 100.0, fy: 90.0, cx: 20.5, cy: 15.0 };
        Camera { intrinsics, width: 40, height: 30, camera_from_world: Rigid::IDENTITY }
    }

    fn depth() -> Grid<f32> {
        Grid::from_fn(20, 15, |x, y| if x == 3 { 0.0 } else { 2.0 + 0.5 * (x + y) as f32 })
    }

    fn png(path: &Path, unit: f64) {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        write_depth_png(&mut fs::File::create(path).unwrap(), &depth(), unit).unwrap();
    }

    #[test]
    fn multi_view_layout_has_its_own_unit_and_numbers_stems_its_own_way() {
        let scene = tempfile::tempdir().unwrap();
        png(&scene.path().join("pseudo_gt/depth_07.png"), 0.02);
        fs::write(scene.path().join("pseudo_gt/meta.json"), r#"{"depth_unit_mm": 0.02}"#).unwrap();
        let reference = Reference::open(scene.path()).unwrap().unwrap();
        let (found, intrinsics) = reference.depth_of("000007", &camera()).unwrap().unwrap();
        assert!(found.as_slice().iter().zip(depth().as_slice()).all(|(a, b)| (a - b).abs() < 0.011));
        assert_eq!(intrinsics, Intrinsics { fx: 50.0, fy: 45.0, cx: 10.25, cy: 7.5 });
        assert!(reference.depth_of("000008", &camera()).unwrap().is_none());
        assert!(reference.points().unwrap().is_none());
        fs::write(scene.path().join("pseudo_gt/meta.json"), "{}").unwrap();
        assert!(Reference::open(scene.path()).unwrap_err().to_string().contains("depth_unit_mm"));
    }

    #[test]
    fn disparities_of_a_rectified_pair_become_depth() {
        let scene = tempfile::tempdir().unwrap();
        let write =
            |name: &str, map: Grid<f32>| write_pfm(&mut fs::File::create(scene.path().join(name)).unwrap(), &map);
        for name in ["im0.png", "im1.png"] {
            write_depth_png(&mut fs::File::create(scene.path().join(name)).unwrap(), &depth(), 0.001).unwrap();
        }
        // 20 x 15 photographs; the right principal point lies 3 pixels farther left, the right camera 0.4 to the right.
        let calib =
            "cam0=[50 0 9.5; 0 50 7; 0 0 1]\ncam1=[50 0 6.5; 0 50 7; 0 0 1]\nbaseline=0.4\nwidth=20\nheight=15\n";
        fs::write(scene.path().join("calib.txt"), calib).unwrap();
        assert_eq!(Reference::open(scene.path()).unwrap(), None);
        let parallax = |z: f32| 50.0 * 0.4 / z;
        write("disp0.pfm", depth().map(|&z| if z > 0.0 { parallax(z) + 3.0 } else { f32::INFINITY })).unwrap();
        let reference = Reference::open(scene.path()).unwrap().unwrap();
        let (found, _) = reference.depth_of("im0", &camera()).unwrap().unwrap();
        assert!(found.as_slice().iter().zip(depth().as_slice()).all(|(a, b)| (a - b).abs() <= 1e-5 * b));
        assert!(reference.depth_of("im1", &camera()).unwrap().is_none());
        // The same map for a photograph of twice the size.
        let twice = Grid::from_fn(40, 30, |x, y| 2.0 * (parallax(depth()[(x / 2, y / 2)].max(1.0)) + 3.0));
        write("disp1GT.pfm", twice).unwrap();
        let (found, _) = reference.depth_of("im1", &camera()).unwrap().unwrap();
        assert!((found[(21, 10)] - depth()[(10, 5)]).abs() < 1e-5);
        fs::write(scene.path().join("calib.txt"), calib.replace("baseline=0.4", "baseline=nan")).unwrap();
        assert!(Reference::open(scene.path()).unwrap_err().to_string().contains("calib.txt"));
        fs::remove_file(scene.path().join("calib.txt")).unwrap();
        assert_eq!(Reference::open(scene.path()).unwrap(), None);
    }

    #[test]
    fn a_mesh_is_a_reference_for_every_camera() {
        let scene = tempfile::tempdir().unwrap();
        let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
            element face 1\nproperty list uchar int vertex_indices\nend_header\n";
        // The triangle lies in the plane z = 4 + x and covers the upper left of the picture.
        let text = format!("{header}-2 -2 2\n2 -2 6\n-2 2 2\n3 0 1 2\n");
        fs::write(scene.path().join("pseudo_gt_mesh.ply"), text).unwrap();
        let reference = Reference::open(scene.path()).unwrap().unwrap();
        let (depth, _) = reference.depth_of("any", &camera()).unwrap().unwrap();
        let at = Camera::pixel_centre(12, 9);
        let expected = 4.0 / (1.0 - (at.x - 20.5) / 100.0);
        assert!((f64::from(depth[(12, 9)]) - expected).abs() < 1e-5, "{} {expected}", depth[(12, 9)]);
        assert_eq!(depth[(39, 29)], 0.0);
    }

    #[test]
    fn sensor_layout_counts_millimetres_and_exact_layout_scene_units() {
        let scene = tempfile::tempdir().unwrap();
        assert_eq!(Reference::open(scene.path()).unwrap(), None);
        png(&scene.path().join("depth/00027.png"), 0.001);
        let sensor = Reference::open(scene.path()).unwrap().unwrap();
        assert_eq!(sensor.depth_of("00027", &camera()).unwrap().unwrap().0, depth());
        write_pfm(&mut fs::File::create(scene.path().join("depth/a.pfm")).unwrap(), &depth()).unwrap();
        let exact = Reference::open(scene.path()).unwrap().unwrap();
        assert_eq!(exact.depth_of("a", &camera()).unwrap().unwrap().0, depth());
        assert_eq!(exact.points().unwrap(), None);
        fs::create_dir_all(scene.path().join("truth")).unwrap();
        let header = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
        fs::write(scene.path().join("truth/points.ply"), format!("{header}end_header\n1 2 3\n")).unwrap();
        assert_eq!(exact.points().unwrap().unwrap().positions, [[1.0, 2.0, 3.0]]);
    }
}
