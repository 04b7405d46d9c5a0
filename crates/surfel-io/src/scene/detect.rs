//! Which cameras a folder holds.
//!
//! Looks only at names, except where several formats share one (`.npz`, `.txt`, `cameras.json`). The
//! result is ordered by preference; the first candidate is taken and the others become a warning.

use super::error::SceneError;
use super::files::ImageFiles;
use super::format::FormatKind;
use super::formats::{colmap, re10k, stereo_calib};
use crate::npy::Npz;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A camera file (or folder of camera files) that was recognised.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Candidate {
    pub kind: FormatKind,
    pub source: PathBuf,
}

/// A scene's root and everything recognised in it, best first.
#[derive(Debug)]
pub(super) struct Detection {
    pub root: PathBuf,
    pub candidates: Vec<Candidate>,
    pub warnings: Vec<String>,
}

/// Finds the scene that `path` (a folder, a camera file or a folder of camera files) means.
pub(super) fn detect(path: &Path, wanted: Option<FormatKind>) -> Result<Detection, SceneError> {
    if let Err(source) = std::fs::metadata(path) {
        return Err(SceneError::Read { path: path.to_owned(), source });
    }
    let own = if path.is_dir() { of_kind(candidates(path), wanted) } else { Vec::new() };
    if !own.is_empty() && holds_photographs(path) {
        return Ok(Detection { root: path.to_owned(), candidates: own, warnings: Vec::new() });
    }
    if let Some(above) = above(path, wanted) {
        return Ok(above);
    }
    if let Some(first) = own.first() {
        // A bare model folder in a layout without a name: its photographs are beside it. Never for a scene
        // that only lost its photographs, or those of a stranger would be found.
        let parent = std::fs::canonicalize(path).ok().and_then(|full| full.parent().map(Path::to_owned));
        let beside = parent.filter(|parent| first.source == path && holds_photographs(parent));
        let (root, warnings) = match beside {
            None => (path.to_owned(), Vec::new()),
            Some(parent) => {
                let (cameras, images) = (first.source.display(), parent.display());
                (parent.clone(), vec![format!("no photographs in {cameras}; looking for them in {images}")])
            }
        };
        return Ok(Detection { root, candidates: own, warnings });
    }
    if path.is_file() {
        return Err(SceneError::NoCameras { path: path.to_owned() });
    }
    below(path, wanted)
}

/// The scene of a camera file, or of a folder like `sparse/0`: the nearest folder above that knows it.
fn above(path: &Path, wanted: Option<FormatKind>) -> Option<Detection> {
    let full = std::fs::canonicalize(path).ok()?;
    // `sparse` means `sparse/0`; a folder with photographs would be a scene of its own.
    let is_model_parent = full.is_dir() && !holds_photographs(&full);
    let means = |candidate: &Candidate| {
        let one_of_many = full.is_file() && candidate.source.is_dir() && full.parent() == Some(&candidate.source);
        candidate.source == full || one_of_many || (is_model_parent && candidate.source.starts_with(&full))
    };
    full.ancestors().skip(1).take(3).find_map(|root| {
        let mut known = of_kind(candidates(root), wanted);
        known.retain(means);
        let found = !known.is_empty() && holds_photographs(root);
        found.then(|| Detection { root: root.to_owned(), candidates: known, warnings: Vec::new() })
    })
}

fn holds_photographs(folder: &Path) -> bool {
    ImageFiles::below(folder).is_ok_and(|files| !files.is_empty())
}

/// Looks one and then two folders down.
fn below(path: &Path, wanted: Option<FormatKind>) -> Result<Detection, SceneError> {
    let mut folders = vec![path.to_owned()];
    for _ in 0..2 {
        folders = folders.iter().flat_map(|folder| subfolders(folder)).collect();
        let mut scenes: Vec<(PathBuf, Vec<Candidate>)> = folders
            .iter()
            .map(|folder| (folder.clone(), of_kind(candidates(folder), wanted)))
            .filter(|(_, candidates)| !candidates.is_empty())
            .collect();
        if scenes.len() > 1 {
            let scenes = scenes.into_iter().map(|(folder, _)| folder).collect();
            return Err(SceneError::SeveralScenes { path: path.to_owned(), scenes });
        }
        if let Some((root, candidates)) = scenes.pop() {
            let warnings = vec![format!("{} holds no cameras itself; opened {} in it", path.display(), root.display())];
            return Ok(Detection { root, candidates, warnings });
        }
    }
    Err(match wanted {
        Some(wanted) => SceneError::NotThisFormat { path: path.to_owned(), wanted },
        None => SceneError::NoCameras { path: path.to_owned() },
    })
}

fn of_kind(candidates: Vec<Candidate>, wanted: Option<FormatKind>) -> Vec<Candidate> {
    candidates.into_iter().filter(|candidate| wanted.is_none_or(|kind| kind == candidate.kind)).collect()
}

/// Everything recognised in `root`, best first; unreadable folders hold nothing.
fn candidates(root: &Path) -> Vec<Candidate> {
    let files = files(root);
    FormatKind::ALL
        .into_iter()
        .flat_map(|kind| sources(kind, root, &files).into_iter().map(move |source| Candidate { kind, source }))
        .collect()
}

fn sources(kind: FormatKind, root: &Path, files: &[PathBuf]) -> Vec<PathBuf> {
    let named = |name: &str| -> Vec<PathBuf> {
        let path = root.join(name);
        if path.is_file() { vec![path] } else { Vec::new() }
    };
    let matching = |accept: &dyn Fn(&str) -> bool| -> Vec<PathBuf> {
        let name = |path: &&PathBuf| path.file_name().is_some_and(|name| accept(&name.to_string_lossy()));
        files.iter().filter(name).cloned().collect()
    };
    let npz_with = |array: &str| -> Vec<PathBuf> {
        let mut found = matching(&|name| name.starts_with("cameras") && name.ends_with(".npz"));
        found.retain(|path| Npz::open(path).is_ok_and(|npz| npz.names().iter().any(|name| name == array)));
        found
    };
    match kind {
        FormatKind::Colmap => colmap_models(root),
        FormatKind::Transforms => {
            let mut found = matching(&|name| name.starts_with("transforms") && name.ends_with(".json"));
            let preference = |path: &PathBuf| match path.file_stem().and_then(|stem| stem.to_str()) {
                Some("transforms") => 0,
                Some("transforms_train") => 1,
                _ => 2,
            };
            found.sort_by_key(preference);
            found
        }
        FormatKind::Idr => {
            idr_files(npz_with("world_mat_0"), matching(&|name| name.starts_with("cameras") && name.ends_with(".npz")))
        }
        FormatKind::RobustMvd => npz_with("to_ref_transform"),
        FormatKind::MvsNet => ["cams", "cams_1", "Cameras", "Cameras/train", "."]
            .into_iter()
            .map(|folder| if folder == "." { root.to_owned() } else { root.join(folder) })
            .filter(|folder| self::files(folder).iter().any(|file| file.to_string_lossy().ends_with("_cam.txt")))
            .collect(),
        FormatKind::Llff => named("poses_bounds.npy"),
        FormatKind::RealEstate10k => {
            let mut found = matching(&|name| name.ends_with(".txt"));
            found.retain(|path| re10k::looks_like(&beginning(path)));
            found
        }
        FormatKind::CamerasJson => named("cameras.json"),
        FormatKind::Middlebury => matching(&|name| name.ends_with("_par.txt")),
        FormatKind::Strecha => {
            let mut folders = vec![root.to_owned()];
            folders.extend(subfolders(root));
            folders.retain(|folder| {
                self::files(folder).iter().any(|file| file.extension().is_some_and(|ext| ext == "camera"))
            });
            folders
        }
        FormatKind::StereoCalib => {
            let mut found = named("calib.txt");
            found.retain(|path| stereo_calib::looks_like(&beginning(path)));
            found
        }
        FormatKind::PosesText if root.join("K.txt").is_file() => named("poses.txt"),
        FormatKind::PosesText => Vec::new(),
        FormatKind::TrajectoryLog => named("trajectory.log"),
    }
}

/// The archives with a first camera; damaged ones count too, so that their fault is reported.
fn idr_files(readable: Vec<PathBuf>, all: Vec<PathBuf>) -> Vec<PathBuf> {
    let damaged = all.into_iter().filter(|path| Npz::open(path).is_err());
    readable.into_iter().chain(damaged).collect()
}

/// COLMAP models, the one with most images first.
fn colmap_models(root: &Path) -> Vec<PathBuf> {
    let mut folders = Vec::new();
    for base in ["sparse", "colmap/sparse", "dense/sparse"] {
        let base = root.join(base);
        folders.extend(subfolders(&base));
        folders.push(base);
    }
    folders.push(root.to_owned());
    folders.retain(|folder| colmap::is_model(folder));
    folders.sort_by_key(|folder| std::cmp::Reverse(colmap::size_of_model(folder)));
    folders
}

fn beginning(path: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(4096).read_to_end(&mut bytes));
    if read.is_err() {
        bytes.clear();
    }
    // A line cut in the middle would not look like the others.
    if bytes.len() == 4096 {
        bytes.truncate(bytes.iter().rposition(|&byte| byte == b'\n').unwrap_or(0));
    }
    bytes
}

fn listing(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(folder).map(|items| items.flatten().map(|item| item.path()).collect()).unwrap_or_default();
    paths.sort();
    paths
}

fn files(folder: &Path) -> Vec<PathBuf> {
    listing(folder).into_iter().filter(|path| path.is_file()).collect()
}

fn subfolders(folder: &Path) -> Vec<PathBuf> {
    let hidden = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    listing(folder).into_iter().filter(|path| path.is_dir() && !hidden(path)).collect()
}
