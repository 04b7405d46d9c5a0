//! Chunks of RealEstate10K and ACID (spec 5.1): PyTorch files of about 100 MB, each a list of scenes.
//!
//! ```text
//! train/index.json      { "<scene>": "000000.torch", ... }
//! train/000000.torch    [{ key, url, timestamps, cameras [N, 18], images: [JPEG bytes], depths?, normals? }, ...]
//! ```
//!
//! A camera is `fx fy cx cy 0 0` in image widths and heights, then `camera_from_world` row by row. Invariant: one chunk
//! is open at a time, and of it only the description and the view that is asked for are in memory.

use crate::map_resample::{depth_at_size, nearest};
use crate::{DataError, SceneViews, TrainingView};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_core::{Camera, Grid, Intrinsics, Rigid};
use surfel_io::depth::decode_depth_png16;
use surfel_io::photo::decode_picture;
use surfel_synth::Random;
use surfel_torch::{TensorRef, TorchFile, Value};

/// Numbers of a camera.
const CAMERA_LEN: usize = 18;
/// Lengths of decoded normals that are taken for one; black and middle gray mean that there is none.
const NORMAL_LENGTHS: std::ops::Range<f32> = 0.5..1.3;

/// What the files of a set do not say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChunkOptions {
    /// Nearest depth, scene units.
    pub near: f64,
    /// Farthest depth, scene units.
    pub far: f64,
    /// Scene units per count of a depth picture.
    pub depth_unit: f64,
    /// Files' units per scene unit.
    pub unit_to_world: f64,
}

impl ChunkOptions {
    /// RealEstate10K and ACID: the unit of each clip's reconstruction.
    pub const CLIPS: Self = Self { near: 1.0, far: 100.0, depth_unit: 1.0, unit_to_world: 1.0 };

    /// DTU packed into chunks: units of 200 mm, depth pictures in millimetres.
    pub const DTU: Self = Self { near: 2.125, far: 4.525, depth_unit: 1.0 / 200.0, unit_to_world: 200.0 };
}

/// A folder of chunks.
#[derive(Clone, Debug)]
pub struct ChunkSet {
    folder: PathBuf,
    options: ChunkOptions,
    /// File by scene.
    index: BTreeMap<String, String>,
}

impl ChunkSet {
    /// Opens a folder with its `index.json`.
    ///
    /// # Errors
    /// [`DataError`] when the index is missing or is no such list.
    pub fn open(folder: &Path, options: ChunkOptions) -> Result<Self, DataError> {
        let path = folder.join("index.json");
        let bytes = std::fs::read(&path).map_err(|source| DataError::Read { path: path.clone(), source })?;
        let index: BTreeMap<String, String> = serde_json::from_slice(&bytes)
            .map_err(|error| DataError::malformed(&path, format!("is no list of a chunk for every scene ({error})")))?;
        if index.is_empty() {
            return Err(DataError::malformed(path, "lists no scene"));
        }
        if let Some((key, file)) = index.iter().find(|(_, file)| Path::new(file).components().count() != 1) {
            let reason = format!("says that scene {key} is in {file:?}; chunks must lie beside the index");
            return Err(DataError::malformed(path, reason));
        }
        Ok(Self { folder: folder.to_owned(), options, index })
    }

    /// Keys of the scenes, sorted.
    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.index.keys().map(String::as_str)
    }

    /// Names of the chunks, sorted.
    pub fn files(&self) -> Vec<&str> {
        let mut files: Vec<&str> = self.index.values().map(String::as_str).collect();
        files.sort_unstable();
        files.dedup();
        files
    }

    /// Names of the chunks in the order of one pass over the set: another one for each pass, the same for each seed.
    pub fn shuffled_files(&self, seed: u64, pass: u64) -> Vec<&str> {
        let (mut files, mut random) = (self.files(), Random::fork(seed, pass));
        for i in (1..files.len()).rev() {
            files.swap(i, random.below(i + 1));
        }
        files
    }

    /// Opens a chunk by its name.
    ///
    /// # Errors
    /// [`DataError`] when it is missing, damaged, or not a list of scenes.
    pub fn chunk(&self, file: &str) -> Result<Chunk, DataError> {
        Chunk::open(&self.folder.join(file), self.options)
    }

    /// Opens the chunk of a scene; also says which scene of it that is.
    ///
    /// # Errors
    /// As [`ChunkSet::chunk`], and when the scene is not where the index says.
    pub fn chunk_of(&self, key: &str) -> Result<(Chunk, usize), DataError> {
        let path = self.folder.join("index.json");
        let file = self.index.get(key);
        let file = file.ok_or_else(|| DataError::malformed(&path, format!("does not list a scene {key}")))?;
        let chunk = self.chunk(file)?;
        let place = chunk.keys().position(|other| other == key);
        let place = place
            .ok_or_else(|| DataError::malformed(path, format!("says that scene {key} is in {file}, but it is not")))?;
        Ok((chunk, place))
    }
}

/// An open chunk.
pub struct Chunk {
    file: TorchFile<BufReader<File>>,
    path: PathBuf,
    scenes: Vec<Entry>,
    options: ChunkOptions,
}

/// What a chunk says about a scene.
struct Entry {
    key: String,
    cameras: Arc<TensorRef>,
    images: Vec<Encoded>,
    /// As many as images, or none at all.
    depths: Vec<Option<Encoded>>,
    normals: Vec<Option<Encoded>>,
}

/// The bytes of a picture.
#[derive(Clone)]
enum Encoded {
    Tensor(Arc<TensorRef>),
    Bytes(Arc<[u8]>),
}

impl Chunk {
    /// Opens a file and reads its description.
    ///
    /// # Errors
    /// [`DataError`] when it is missing, damaged, or not a list of scenes.
    pub fn open(path: &Path, options: ChunkOptions) -> Result<Self, DataError> {
        let file = TorchFile::open(path)?;
        let malformed = |reason: String| DataError::malformed(path, reason);
        let list = file.root().as_list();
        let list = list.ok_or_else(|| malformed(format!("holds {}, not a list of scenes", file.root().kind())))?;
        let entry =
            |(i, value): (usize, &Value)| Entry::of(value).map_err(|reason| malformed(format!("scene {i} {reason}")));
        let scenes = list.iter().enumerate().map(entry).collect::<Result<_, _>>()?;
        Ok(Self { file, path: path.to_owned(), scenes, options })
    }

    /// Number of scenes.
    pub fn len(&self) -> usize {
        self.scenes.len()
    }

    /// True for a chunk without scenes.
    pub fn is_empty(&self) -> bool {
        self.scenes.is_empty()
    }

    /// Keys of the scenes, in the order of the file.
    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.scenes.iter().map(|scene| scene.key.as_str())
    }

    /// Opens one scene: reads its cameras.
    ///
    /// # Errors
    /// [`DataError`] when a camera is unusable.
    ///
    /// # Panics
    /// If there is no such scene.
    pub fn scene(&mut self, index: usize) -> Result<ChunkScene<'_>, DataError> {
        let entry = &self.scenes[index];
        let rows = self.file.tensor(&entry.cameras)?.to_f64();
        let camera = |(frame, row): (usize, &[f64; CAMERA_LEN])| {
            let view = || format!("scene {} frame {frame}", entry.key);
            let [fx, fy, cx, cy] = [row[0], row[1], row[2], row[3]];
            if !(fx > 0.0 && fy > 0.0 && [fx, fy, cx, cy].iter().all(|value| value.is_finite())) {
                let reason =
                    format!("{}: focal lengths {fx} and {fy} and principal point {cx}, {cy} are no camera", view());
                return Err(DataError::malformed(&self.path, reason));
            }
            let m = &row[6..];
            let rotation = DMat3::from_cols_array(&[m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]]).transpose();
            let pose = Rigid::from_matrix(rotation, DVec3::new(m[3], m[7], m[11]));
            let pose = pose.map_err(|source| DataError::Pose { path: self.path.clone(), view: view(), source })?;
            Ok((Intrinsics { fx, fy, cx, cy }, pose))
        };
        let cameras = rows.as_chunks().0.iter().enumerate().map(camera).collect::<Result<_, _>>()?;
        Ok(ChunkScene { file: &mut self.file, path: &self.path, entry, cameras, options: self.options })
    }
}

impl Entry {
    fn of(value: &Value) -> Result<Self, String> {
        let field = |name: &str| value.get(name).ok_or_else(|| format!("has no {name:?}"));
        let key = field("key")?.as_str().ok_or("has a \"key\" that is no text")?.to_owned();
        let wrong = |name: &str, what: &str| format!("({key}) has {name:?} that is {what}");
        let images = field("images")?;
        let images = images.as_list().ok_or_else(|| wrong("images", "no list"))?;
        let images: Option<Vec<Encoded>> = images.iter().map(Encoded::of).collect();
        let images = images.ok_or_else(|| wrong("images", "no list of encoded pictures"))?;
        let cameras = field("cameras")?.as_tensor().ok_or_else(|| wrong("cameras", "no tensor"))?.clone();
        if cameras.shape() != [images.len(), CAMERA_LEN] {
            let shape =
                format!("of shape {:?}; its {} images need {CAMERA_LEN} numbers each", cameras.shape(), images.len());
            return Err(wrong("cameras", &shape));
        }
        let maps = |name: &str| -> Result<Vec<Option<Encoded>>, String> {
            let Some(list) = value.get(name).filter(|value| !matches!(value, Value::None)) else {
                return Ok(Vec::new());
            };
            let list = list.as_list().ok_or_else(|| wrong(name, "no list"))?;
            if list.len() != images.len() {
                return Err(wrong(name, &format!("a list of {} for {} images", list.len(), images.len())));
            }
            Ok(list.iter().map(Encoded::of).collect())
        };
        let (depths, normals) = (maps("depths")?, maps("normals")?);
        Ok(Self { key, cameras, images, depths, normals })
    }
}

impl Encoded {
    /// `None` for `None` and for anything that is no row of bytes.
    fn of(value: &Value) -> Option<Self> {
        match value {
            Value::Tensor(tensor) if tensor.dtype().size() == 1 => Some(Self::Tensor(tensor.clone())),
            Value::Bytes(bytes) => Some(Self::Bytes(bytes.clone())),
            _ => None,
        }
    }

    fn read(&self, file: &mut TorchFile<BufReader<File>>) -> Result<Vec<u8>, DataError> {
        match self {
            Self::Tensor(tensor) => Ok(file.tensor(tensor)?.into_bytes()),
            Self::Bytes(bytes) => Ok(bytes.to_vec()),
        }
    }
}

/// A scene of an open chunk.
pub struct ChunkScene<'a> {
    file: &'a mut TorchFile<BufReader<File>>,
    path: &'a Path,
    entry: &'a Entry,
    cameras: Vec<(Intrinsics, Rigid)>,
    options: ChunkOptions,
}

impl SceneViews for ChunkScene<'_> {
    fn name(&self) -> &str {
        &self.entry.key
    }

    fn num_views(&self) -> usize {
        self.cameras.len()
    }

    fn range(&self) -> (f64, f64) {
        (self.options.near, self.options.far)
    }

    fn unit_to_world(&self) -> f64 {
        self.options.unit_to_world
    }

    fn view(&mut self, index: usize) -> Result<TrainingView, DataError> {
        let key = &self.entry.key;
        // What a picture is called in messages.
        let called = |what: &str| PathBuf::from(format!("{}: scene {key} {what} {index}", self.path.display()));
        let image = decode_picture(&self.entry.images[index].read(self.file)?, &called("image"))?;
        let (width, height) = (image.width(), image.height());
        let (k, camera_from_world) = self.cameras[index];
        let (w, h) = (width as f64, height as f64);
        let intrinsics = Intrinsics { fx: k.fx * w, fy: k.fy * h, cx: k.cx * w, cy: k.cy * h };
        let camera = Camera { intrinsics, width, height, camera_from_world };
        let same_shape = |what: &str, w: usize, h: usize| match w * height == h * width {
            true => Ok(()),
            false => Err(DataError::malformed(
                called(what),
                format!("has {w}x{h} pixels, another shape than the image's {width}x{height}"),
            )),
        };
        let mut depth = None;
        if let Some(Some(encoded)) = self.entry.depths.get(index) {
            let map = decode_depth_png16(&encoded.read(self.file)?, &called("depth"), self.options.depth_unit)?;
            same_shape("depth", map.width(), map.height())?;
            depth = Some(depth_at_size(&map, width, height));
        }
        let mut normal = None;
        if let Some(Some(encoded)) = self.entry.normals.get(index) {
            let map = decode_picture(&encoded.read(self.file)?, &called("normals"))?;
            same_shape("normals", map.width(), map.height())?;
            normal = Some(facing_normals(&nearest(&map, width, height), &camera));
        }
        Ok(TrainingView { name: format!("{key} {index}"), image, camera, depth, normal, mask: None })
    }
}

/// `2 c - 1`, unit length, facing the camera.
fn facing_normals(colours: &Grid<[f32; 3]>, camera: &Camera) -> Grid<[f32; 3]> {
    Grid::from_fn(colours.width(), colours.height(), |x, y| {
        let n = colours[(x, y)].map(|c| 2.0 * c - 1.0);
        let length = n.iter().map(|v| v * v).sum::<f32>().sqrt();
        if !NORMAL_LENGTHS.contains(&length) {
            return [0.0; 3];
        }
        let ray = camera.ray(Camera::pixel_centre(x, y)).as_vec3();
        let away = n[0] * ray.x + n[1] * ray.y + n[2] * ray.z > 0.0;
        n.map(|v| if away { -v / length } else { v / length })
    })
}
