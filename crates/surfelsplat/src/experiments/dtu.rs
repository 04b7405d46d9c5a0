//! The DTU mesh benchmark on any meshes: culled by object masks, scored by the official protocol (spec 7.1).
//!
//! Everything in millimetres of the scanner's frame, which is the frame of `world_mat` cameras and hence of our own
//! results on them. Without the official data a scene's own reference points can stand in; the report then says that
//! the figures are not those of the paper. Invariant: what was culled by which masks, and what a mesh was compared
//! with, is stated beside every figure.

use super::error::ExperimentError;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use surfel_core::TriMesh;
use surfel_eval::cull::{Cull, MaskedView, cull};
use surfel_eval::dtu::{DtuReference, DtuScore, DtuSettings, score_against_points, score_dtu};
use surfel_io::scene::{Frame, Scene};

/// A mesh of one scan.
pub struct Candidate {
    /// What to call it in tables.
    pub name: String,
    /// Number of the scan (24, 37, ...).
    pub scan: u32,
    /// The mesh, mm, scanner frame.
    pub mesh: TriMesh,
    /// Photographs it was made from, by name, stem or number; empty = unknown.
    pub inputs: Vec<String>,
}

/// What meshes are compared with.
pub enum Ground {
    /// The official files of a scan.
    Official(Box<DtuReference>),
    /// Points of whatever origin, mm.
    Points(Vec<[f32; 3]>),
}

/// One score.
#[derive(Clone, Debug)]
pub struct DtuResult {
    /// Name of the candidate.
    pub name: String,
    /// Its scan.
    pub scan: u32,
    /// How it was culled.
    pub cull: Cull,
    /// Masks that culled it.
    pub num_masks: usize,
    /// Triangles left.
    pub num_triangles: usize,
    /// The score.
    pub score: DtuScore,
}

/// Cuts a candidate by each rule and scores what is left.
///
/// # Errors
/// When a rule needs masks and `scene` is missing, has none, or does not hold the input photographs.
pub fn score_candidate(
    candidate: &Candidate,
    ground: &Ground,
    rules: &[Cull],
    scene: Option<&Scene>,
) -> Result<Vec<DtuResult>, ExperimentError> {
    let settings = DtuSettings::default();
    rules
        .iter()
        .map(|&rule| {
            let masks = masks_for(rule, candidate, scene)?;
            let mesh = cull(&candidate.mesh, rule, &masks);
            let score = match ground {
                Ground::Official(reference) => score_dtu(&mesh, reference, &settings),
                Ground::Points(points) => score_against_points(&mesh, points, &settings),
            };
            Ok(DtuResult {
                name: candidate.name.clone(),
                scan: candidate.scan,
                cull: rule,
                num_masks: masks.len(),
                num_triangles: mesh.triangles.len(),
                score,
            })
        })
        .collect()
}

fn masks_for(rule: Cull, candidate: &Candidate, scene: Option<&Scene>) -> Result<Vec<MaskedView>, ExperimentError> {
    let request = |text: String| Err(ExperimentError::Request(text));
    if rule == Cull::None {
        return Ok(Vec::new());
    }
    let Some(scene) = scene else {
        return request(format!(
            "culling `{}` needs the object masks of scan {}; name the folder with its cameras and masks (--scenes), or take --cull none",
            rule.name(),
            candidate.scan
        ));
    };
    let frames: Vec<usize> = match rule {
        Cull::Sparse if candidate.inputs.is_empty() => {
            return request(format!(
                "{}: culling `sparse` needs the input photographs; name them with --views, or take --cull dense",
                candidate.name
            ));
        }
        Cull::Sparse => scene.select(&candidate.inputs).map_err(|error| ExperimentError::Request(error.to_string()))?,
        _ => (0..scene.frames.len()).collect(),
    };
    let masks: Vec<MaskedView> = frames
        .par_iter()
        .map(|&frame| masked_view(&scene.frames[frame]))
        .filter_map(Result::transpose)
        .collect::<Result<_, _>>()?;
    if masks.is_empty() {
        return request(format!("{} has no object masks; take --cull none", scene.root.display()));
    }
    Ok(masks)
}

/// Mask and camera of a photograph at its own size; `None` without a mask.
fn masked_view(frame: &Frame) -> Result<Option<MaskedView>, ExperimentError> {
    if frame.mask_path.is_none() {
        return Ok(None);
    }
    let full = frame.pinhole();
    let view = frame.load(full.width, full.height).map_err(|error| ExperimentError::Request(error.to_string()))?;
    Ok(Some(MaskedView { camera: view.camera, mask: view.valid }))
}

/// The scan that a path is about: the last part of it that reads `scan24`, `dtu_scan24`, `24.ply`, ...
pub fn scan_of(path: &Path) -> Option<u32> {
    let parts: Vec<String> = path.components().map(|c| c.as_os_str().to_string_lossy().to_lowercase()).collect();
    let digits = |text: &str| -> Option<u32> {
        let number: String = text.chars().take_while(char::is_ascii_digit).collect();
        number.parse().ok()
    };
    let named = parts.iter().rev().find_map(|part| {
        part.rmatch_indices("scan")
            .find_map(|(at, word)| digits(part[at + word.len()..].trim_start_matches(['_', '-'])))
    });
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    named.or_else(|| stem.filter(|stem| stem.chars().all(|c| c.is_ascii_digit())).and_then(digits))
}

/// The mesh file of a result: the file itself, or `mesh.ply` in a folder.
pub fn mesh_path(result: &Path) -> PathBuf {
    if result.is_dir() { result.join("mesh.ply") } else { result.to_owned() }
}

/// Photographs that a result folder was made from, as its `cameras.json` lists them; empty when there is none.
///
/// # Errors
/// When there is one and it does not parse.
pub fn inputs_of(result: &Path) -> Result<Vec<String>, ExperimentError> {
    let path = result.join("cameras.json");
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let text = std::fs::read(&path).map_err(|source| ExperimentError::File { path: path.clone(), source })?;
    let wrong = || ExperimentError::Request(format!("{}: is not a list of cameras with `image`", path.display()));
    let json: serde_json::Value = serde_json::from_slice(&text).map_err(|_| wrong())?;
    let stem = |entry: &serde_json::Value| {
        let name = Path::new(entry["image"].as_str()?);
        Some(name.file_stem()?.to_string_lossy().into_owned())
    };
    json.as_array().ok_or_else(wrong)?.iter().map(|entry| stem(entry).ok_or_else(wrong)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scans_are_found_in_paths() {
        let scan = |path: &str| scan_of(Path::new(path));
        assert_eq!(scan("results/scan24/mesh.ply"), Some(24));
        assert_eq!(scan("data/dtu_scan105/out"), Some(105));
        assert_eq!(scan("meshes/24.ply"), Some(24));
        assert_eq!(scan("scan_37.ply"), Some(37));
        assert_eq!(scan("scan24/variant_scan65.ply"), Some(65));
        assert_eq!(scan("out/mesh.ply"), None);
        assert_eq!(scan("scanner/mesh.ply"), None);
    }
}
