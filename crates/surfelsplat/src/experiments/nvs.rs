//! New views: surfels rendered where a held-out photograph was taken, compared with it (spec 7.4).
//!
//! Pixels that no surfel reaches stay black and count; a second figure looks at covered pixels only, and says how many
//! those are. Invariant: a photograph that the surfels were made from is never a target unless it is named.

use super::error::ExperimentError;
use crate::reconstruct::working_size::default_size;
use glam::{DMat3, Vec3};
use std::path::Path;
use surfel_core::{Camera, Grid, Similarity, Surfels};
use surfel_eval::psnr::psnr;
use surfel_eval::report::{Cell, Figure, Report, Table};
use surfel_eval::ssim::ssim;
use surfel_io::scene::Scene;
use surfel_io::write::picture_png::write_rgb_png;
use surfel_io::write::surfels_from_ply::{SurfelFile, read_surfels_ply};
use surfel_loss::LossError;
use surfel_raster::{RenderConfig, SurfelSlices, render};
use surfel_synth::contact_sheet::contact_sheet;

/// A perceptual distance between a rendering and a photograph, such as LPIPS: smaller is more alike.
pub struct Perceptual<'a> {
    /// Column heading.
    pub name: &'a str,
    /// Both pictures sRGB in \[0, 1\], of one size.
    pub distance: &'a dyn Fn(&Grid<[f32; 3]>, &Grid<[f32; 3]>) -> Result<f64, LossError>,
}

/// Opacity from which a pixel counts as covered.
const COVERED: f32 = 0.5;

/// One target view.
pub struct TargetScore {
    /// Name of the photograph.
    pub name: String,
    /// Decibels over all valid pixels.
    pub psnr: f64,
    /// Decibels over the covered ones.
    pub psnr_covered: f64,
    /// Share of the valid pixels that surfels cover.
    pub coverage: f64,
    /// Structural similarity of the whole pictures, masked pixels black in both.
    pub ssim: f64,
    /// The perceptual distance, where one was given.
    pub perceptual: Option<f64>,
    /// Photograph and rendering.
    pub pictures: [Grid<[f32; 3]>; 2],
}

/// Reads `surfels.ply` of a result folder, or the file itself.
///
/// # Errors
/// When it cannot be read or is no splat file.
pub fn read_surfels(result: &Path) -> Result<SurfelFile, ExperimentError> {
    let path = if result.is_dir() { result.join("surfels.ply") } else { result.to_owned() };
    let failed = |source| ExperimentError::File { path: path.clone(), source };
    let file = std::fs::File::open(&path).map_err(failed)?;
    read_surfels_ply(&mut std::io::BufReader::new(file)).map_err(failed)
}

/// Renders the surfels at each target photograph and scores them; `size` is that of the renderings (default: as
/// `reconstruct` chooses it).
///
/// # Errors
/// When a photograph cannot be read or the surfels cannot be rendered.
pub fn score_targets(
    file: &SurfelFile,
    scene: &Scene,
    targets: &[usize],
    size: Option<(usize, usize)>,
    perceptual: Option<&Perceptual>,
) -> Result<Vec<TargetScore>, ExperimentError> {
    // Centres are stored relative to an origin: move the cameras there rather than lose digits.
    let to_origin = Similarity { scale: 1.0, rotation: DMat3::IDENTITY, translation: -file.origin };
    let score = |&target: &usize| {
        let frame = &scene.frames[target];
        let (width, height) = size.unwrap_or_else(|| default_size(frame.width, frame.height));
        let view = frame.load(width, height).map_err(|error| ExperimentError::Request(error.to_string()))?;
        let camera = view.camera.in_frame(&to_origin);
        let (picture, alpha) = rendered(&file.surfels, &camera)
            .map_err(|error| ExperimentError::Request(format!("{}: {error}", frame.name)))?;
        let masked = |image: &Grid<[f32; 3]>| {
            Grid::from_fn(width, height, |x, y| if view.valid[(x, y)] { image[(x, y)] } else { [0.0; 3] })
        };
        let covered = Grid::from_fn(width, height, |x, y| view.valid[(x, y)] && alpha[(x, y)] >= COVERED);
        let (photograph, picture) = (masked(&view.image), masked(&picture));
        let count = |mask: &Grid<bool>| mask.as_slice().iter().filter(|on| **on).count();
        Ok(TargetScore {
            name: frame.name.clone(),
            psnr: psnr_within(&picture, &photograph, &view.valid),
            psnr_covered: psnr_within(&picture, &photograph, &covered),
            coverage: count(&covered) as f64 / count(&view.valid).max(1) as f64,
            ssim: ssim(&picture, &photograph),
            perceptual: perceptual
                .map(|p| (p.distance)(&picture, &photograph))
                .transpose()
                .map_err(|error| ExperimentError::Request(format!("{}: {error}", frame.name)))?,
            pictures: [photograph, picture],
        })
    };
    targets.iter().map(score).collect()
}

/// Colour over black, and opacity.
fn rendered(surfels: &Surfels, camera: &Camera) -> Result<(Grid<[f32; 3]>, Grid<f32>), surfel_raster::RasterError> {
    let depths = surfels
        .centres
        .iter()
        .map(|p| camera.camera_from_world.transform(Vec3::from(*p).as_dvec3()).z)
        .filter(|z| *z > 0.0);
    let (near, far) = depths.fold((f64::INFINITY, 0.0f64), |(near, far), z| (near.min(z), far.max(z)));
    if far <= 0.0 {
        let (width, height) = (camera.width, camera.height);
        return Ok((Grid::filled(width, height, [0.0; 3]), Grid::filled(width, height, 0.0)));
    }
    let config = RenderConfig::for_depth_range(near, far.max(near * 1.001));
    let maps = render(&SurfelSlices::from(surfels), camera, &config)?;
    Ok((maps.colour, maps.alpha))
}

/// PSNR over the pixels of a mask.
fn psnr_within(picture: &Grid<[f32; 3]>, reference: &Grid<[f32; 3]>, mask: &Grid<bool>) -> f64 {
    let inside = |image: &Grid<[f32; 3]>| {
        let kept: Vec<[f32; 3]> =
            image.as_slice().iter().zip(mask.as_slice()).filter(|(_, on)| **on).map(|(pixel, _)| *pixel).collect();
        Grid::from_vec(kept.len(), 1, kept)
    };
    psnr(&inside(picture), &inside(reference))
}

/// The report, with a page of photograph and rendering pairs.
pub fn report(scores: &[TargetScore], surfels: &str, perceptual: Option<&Perceptual>) -> Report {
    let name = perceptual.map(|p| p.name);
    let columns = ["view", "PSNR", "PSNR, covered", "coverage", "SSIM"].into_iter().chain(name);
    let mut table = Table::new("New views", columns);
    let row = |name: &str, values: [f64; 4], distance: Option<f64>| {
        let [psnr, covered, coverage, ssim] = values;
        [name.into(), Cell::Value(psnr, 2), Cell::Value(covered, 2), Cell::Share(coverage), Cell::Value(ssim, 4)]
            .into_iter()
            .chain(distance.map(|d| Cell::Value(d, 4)))
            .collect::<Vec<_>>()
    };
    for s in scores {
        table.push(row(&s.name, [s.psnr, s.psnr_covered, s.coverage, s.ssim], s.perceptual));
    }
    let mean = |field: fn(&TargetScore) -> f64| {
        let values: Vec<f64> = scores.iter().map(field).filter(|v| v.is_finite()).collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    let distance = name.map(|_| mean(|s| s.perceptual.unwrap_or(f64::NAN)));
    let means = [mean(|s| s.psnr), mean(|s| s.psnr_covered), mean(|s| s.coverage), mean(|s| s.ssim)];
    table.push(row("mean", means, distance));
    let tiles: Vec<Grid<[f32; 3]>> = scores.iter().flat_map(|s| s.pictures.clone()).collect();
    let mut content = Vec::new();
    // Writing to memory fails only for a picture without pixels, and then there is nothing to show.
    let drawn = write_rgb_png(&mut content, &contact_sheet(&tiles, 4));
    let figure = Figure { title: "Photograph and rendering".to_owned(), file: "views.png".to_owned(), content };
    let missing = "LPIPS is missing: it needs the weights of VGG16, which do not ship (--lpips FILE; docs/lpips.md).";
    Report {
        title: format!("New views rendered from {surfels}"),
        notes: vec![
            "PSNR in decibels and SSIM (Gaussian window of 11 pixels, sample covariance, 5 border pixels left out) on \
             sRGB in [0, 1]; pixels that no surfel reaches are black and count, except in the column of covered \
             pixels. Pixels outside a photograph's mask are black in both, which flatters SSIM. Two photographs do not \
             see everything a third one does, so coverage limits the first column."
                .to_owned(),
        ]
        .into_iter()
        .chain(name.is_none().then(|| missing.to_owned()))
        .collect(),
        tables: vec![table],
        figures: drawn.is_ok().then_some(figure).into_iter().collect(),
    }
}
