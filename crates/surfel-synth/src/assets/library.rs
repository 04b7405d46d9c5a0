//! The folder of scans, textures and light maps, opened for one side of its split.
//!
//! Expects `index.json`, `split.json`, `meshes/*.glb`, `textures/` and `envmaps/`, each with their own
//! `index.json`. Invariant: a library opened for [`Split::Train`] cannot hand out a validation mesh.

use super::error::AssetError;
use super::glb::read_glb;
use super::light::Irradiance;
use super::mesh::TexturedMesh;
use super::texels::Texels;
use glam::Vec3;
use serde::Deserialize;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Which objects may be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// Those to learn from.
    Train,
    /// Those to measure on; never learned from.
    Val,
}

/// One mesh as listed in `index.json`.
#[derive(Clone, Debug, Deserialize)]
pub struct MeshEntry {
    /// Name, unique in the library.
    pub name: String,
    /// File name under `meshes/`.
    pub file: String,
    /// Edges of the bounding box, file units.
    pub extent: [f32; 3],
    /// Words about it: "object", "furniture", "statue", "untextured".
    #[serde(default)]
    pub tags: Vec<String>,
    /// "y" or "z".
    #[serde(default)]
    pub up: String,
}

impl MeshEntry {
    /// True for entries with this word.
    pub fn has_tag(&self, tag: &str) -> bool {
        self.tags.iter().any(|t| t == tag)
    }
}

/// Light and backdrop of a place.
pub struct Environment {
    /// Its diffuse light, scaled so that a surface facing up receives 1.
    pub irradiance: Irradiance,
    /// Its panorama.
    pub panorama: Arc<Texels>,
}

/// An opened assets folder. Cheap to share between threads; loads on demand and remembers.
pub struct AssetLibrary {
    folder: PathBuf,
    meshes: Vec<MeshEntry>,
    materials: Vec<PathBuf>,
    patterns: Vec<PathBuf>,
    photos: Vec<PathBuf>,
    environments: Vec<String>,
    cache: Mutex<Cache>,
}

/// Least recently used entries go first once their bytes exceed the limit.
struct Cache {
    limit: usize,
    clock: u64,
    entries: HashMap<PathBuf, (u64, usize, Cached)>,
}

#[derive(Clone)]
enum Cached {
    Mesh(Arc<TexturedMesh>),
    Image(Arc<Texels>),
    Environment(Arc<Environment>),
}

/// Bytes of decoded assets kept unless said otherwise.
const DEFAULT_MEMORY: usize = 1 << 30;

#[derive(Deserialize)]
struct SplitFile {
    train: Vec<String>,
    val: Vec<String>,
}

#[derive(Deserialize)]
struct TextureEntry {
    file: String,
}

#[derive(Deserialize)]
struct EnvironmentEntry {
    name: String,
}

impl AssetLibrary {
    /// Reads the lists of a folder; no mesh is loaded yet.
    ///
    /// # Errors
    /// When a list is missing, malformed or empty.
    pub fn open(folder: impl AsRef<Path>, split: Split) -> Result<Self, AssetError> {
        let folder = folder.as_ref().to_path_buf();
        let lists: SplitFile = read_json(&folder.join("split.json"))?;
        let names = match split {
            Split::Train => lists.train,
            Split::Val => lists.val,
        };
        let index = folder.join("index.json");
        let mut meshes: Vec<MeshEntry> = read_json(&index)?;
        meshes.retain(|entry| names.contains(&entry.name));
        meshes.sort_by(|a, b| a.name.cmp(&b.name));
        let textures_index = folder.join("textures/index.json");
        let mut textures: Vec<TextureEntry> = read_json(&textures_index)?;
        textures.sort_by(|a, b| a.file.cmp(&b.file));
        let environments_index = folder.join("envmaps/index.json");
        let mut environments: Vec<EnvironmentEntry> = read_json(&environments_index)?;
        environments.sort_by(|a, b| a.name.cmp(&b.name));
        let of_kind = |kind: TextureKind| -> Vec<PathBuf> {
            let files = textures.iter().map(|t| &t.file).filter(|file| TextureKind::of(file) == kind);
            files.map(|file| folder.join("textures").join(file)).collect()
        };
        let library = Self {
            materials: of_kind(TextureKind::Material),
            patterns: of_kind(TextureKind::Pattern),
            photos: of_kind(TextureKind::Photo),
            environments: environments.into_iter().map(|e| e.name).collect(),
            cache: Mutex::new(Cache { limit: DEFAULT_MEMORY, clock: 0, entries: HashMap::new() }),
            meshes,
            folder,
        };
        let empty = |path: PathBuf, what| Err(AssetError::Empty { path, what });
        if library.meshes.is_empty() {
            return empty(index, "mesh of this split");
        }
        if library.materials.is_empty() || library.photos.is_empty() || library.patterns.is_empty() {
            return empty(textures_index, "texture of some kind (materials, patterns, photos)");
        }
        if library.environments.is_empty() {
            return empty(environments_index, "light map");
        }
        Ok(library)
    }

    /// Keeps at most about `bytes` of decoded assets in memory.
    pub fn with_memory_limit(self, bytes: usize) -> Self {
        if let Ok(mut cache) = self.cache.lock() {
            cache.limit = bytes;
        }
        self
    }

    /// All meshes of this split, by name.
    pub fn meshes(&self) -> &[MeshEntry] {
        &self.meshes
    }

    /// Files of tileable materials: wood, stone, plaster.
    pub fn materials(&self) -> &[PathBuf] {
        &self.materials
    }

    /// Files of printed patterns: stripes, dots, paisley.
    pub fn patterns(&self) -> &[PathBuf] {
        &self.patterns
    }

    /// Files of photographs.
    pub fn photos(&self) -> &[PathBuf] {
        &self.photos
    }

    /// Number of light maps.
    pub fn num_environments(&self) -> usize {
        self.environments.len()
    }

    /// A mesh by name, loaded now or remembered.
    ///
    /// # Errors
    /// When the name is not in this split, or the file is broken.
    pub fn mesh(&self, name: &str) -> Result<Arc<TexturedMesh>, AssetError> {
        let entry = self.meshes.iter().find(|entry| entry.name == name);
        let entry = entry.ok_or_else(|| AssetError::Unknown(name.to_owned()))?;
        let path = self.folder.join("meshes").join(&entry.file);
        if let Some(Cached::Mesh(mesh)) = self.remembered(&path) {
            return Ok(mesh);
        }
        let mesh = Arc::new(load_mesh(&path, entry.up == "y")?);
        self.remember(path, mesh.memory(), Cached::Mesh(Arc::clone(&mesh)));
        Ok(mesh)
    }

    /// An image file with its mip levels, loaded now or remembered.
    ///
    /// # Errors
    /// When the file cannot be read or decoded.
    pub fn image(&self, path: &Path) -> Result<Arc<Texels>, AssetError> {
        if let Some(Cached::Image(image)) = self.remembered(path) {
            return Ok(image);
        }
        let image = Arc::new(decode(&read(path)?, path)?);
        self.remember(path.to_path_buf(), image.memory(), Cached::Image(Arc::clone(&image)));
        Ok(image)
    }

    /// The light map at an index, loaded now or remembered.
    ///
    /// # Errors
    /// When its files cannot be read or decoded.
    pub fn environment(&self, index: usize) -> Result<Arc<Environment>, AssetError> {
        let name = &self.environments[index % self.environments.len()];
        let path = self.folder.join("envmaps").join(format!("{name}.hdr"));
        if let Some(Cached::Environment(environment)) = self.remembered(&path) {
            return Ok(environment);
        }
        let bytes = read(&path)?;
        let map = image::load_from_memory_with_format(&bytes, image::ImageFormat::Hdr)
            .map_err(|source| AssetError::Image { path: path.clone(), source })?
            .into_rgb32f();
        let radiance: Vec<Vec3> = map.pixels().map(|p| Vec3::from(p.0)).collect();
        let irradiance = Irradiance::from_equirect(map.width() as usize, &radiance);
        let level = irradiance.level().max(1e-6);
        let irradiance = irradiance.scaled(1.0 / level);
        let panorama = self.image(&self.folder.join("envmaps").join(format!("{name}_bg.jpg")))?;
        let environment = Arc::new(Environment { irradiance, panorama });
        self.remember(path, 1024, Cached::Environment(Arc::clone(&environment)));
        Ok(environment)
    }

    fn remembered(&self, path: &Path) -> Option<Cached> {
        let mut cache = self.cache.lock().ok()?;
        cache.clock += 1;
        let now = cache.clock;
        let (used, _, cached) = cache.entries.get_mut(path)?;
        *used = now;
        Some(cached.clone())
    }

    fn remember(&self, path: PathBuf, bytes: usize, cached: Cached) {
        let Ok(mut cache) = self.cache.lock() else { return };
        cache.clock += 1;
        let now = cache.clock;
        cache.entries.insert(path, (now, bytes, cached));
        let mut total: usize = cache.entries.values().map(|(_, bytes, _)| bytes).sum();
        while total > cache.limit && cache.entries.len() > 1 {
            let oldest = cache.entries.iter().min_by_key(|(_, (used, ..))| *used).map(|(path, _)| path.clone());
            let Some((_, bytes, _)) = oldest.and_then(|path| cache.entries.remove(&path)) else { return };
            total -= bytes;
        }
    }
}

#[derive(PartialEq)]
enum TextureKind {
    Material,
    Pattern,
    Photo,
}

impl TextureKind {
    /// Photographs lie in `photo_*`; the VIMA set is printed patterns but for its wood, tiles and bricks.
    fn of(file: &str) -> Self {
        let is_natural = ["wood", "tiles", "brick"].iter().any(|word| file.contains(word));
        if file.starts_with("photo") {
            Self::Photo
        } else if file.contains("/vima_") && !is_natural {
            Self::Pattern
        } else {
            Self::Material
        }
    }
}

/// Reads and prepares one GLB file.
///
/// # Errors
/// When it cannot be read, parsed or decoded, or holds no triangle.
pub fn load_mesh(path: &Path, up_is_y: bool) -> Result<TexturedMesh, AssetError> {
    let bytes = read(path)?;
    let broken = |problem: String| AssetError::Glb { path: path.to_path_buf(), problem };
    let glb = read_glb(&bytes).map_err(broken)?;
    let images = glb.images.iter().map(|image| decode(image, path).map(Arc::new));
    let images = images.collect::<Result<Vec<_>, _>>()?;
    TexturedMesh::new(&glb, &images, up_is_y).ok_or_else(|| broken("it holds no triangle".into()))
}

fn read(path: &Path) -> Result<Vec<u8>, AssetError> {
    std::fs::read(path).map_err(|source| AssetError::Read { path: path.to_path_buf(), source })
}

fn decode(bytes: &[u8], path: &Path) -> Result<Texels, AssetError> {
    let picture = image::load_from_memory(bytes);
    picture.map(|p| Texels::new(&p)).map_err(|source| AssetError::Image { path: path.to_path_buf(), source })
}

fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, AssetError> {
    let text = read(path)?;
    serde_json::from_slice(&text).map_err(|source| AssetError::Json { path: path.to_path_buf(), source })
}
