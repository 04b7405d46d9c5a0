//! What a network says of a sample, as a picture beside the truth: the fastest way to see what a run learns.
//!
//! Written into the folder of the run every so often. Invariant: nothing here touches the run.

use crate::error::TrainError;
use crate::sample::Sample;
use crate::truth::ViewTruth;
use std::path::Path;
use surfel_core::Grid;
use surfel_core::normals::normal_from_rotation;
use surfel_io::write::preview::{PreviewRow, write_preview};
use surfel_io::write::write_atomically;
use surfel_net::{SurfelNet, values};
use surfel_raster::{SurfelSlices, render};

/// Depth error shown white, steps.
const WHITE_STEPS: f32 = 4.0;

/// Two rows a view: the truth with the confidence, and the prediction with its error in depth.
struct Panels {
    confidence: Grid<[f32; 3]>,
    depth: Grid<f32>,
    normal: Grid<[f32; 3]>,
    rendered: Grid<[f32; 3]>,
    error: Grid<[f32; 3]>,
}

/// Writes the picture to `path`, a PNG.
///
/// # Errors
/// When the network refuses the sample or the file cannot be written.
pub(crate) fn write(net: &SurfelNet, sample: &Sample, path: &Path) -> Result<(), TrainError> {
    let prediction = net.forward(&sample.input(net.config()), &net.device())?;
    let (depth, confidence) = (values(prediction.maps.depth), values(prediction.maps.confidence));
    let surfels = prediction.surfels.to_surfels();
    let (width, height) = sample.size();
    let panels = |view: usize| -> Result<Panels, TrainError> {
        let camera = &sample.cameras[view];
        let at = |x: usize, y: usize| view * width * height + y * width + x;
        let config = sample.ranges[view].render_config();
        let step = sample.seeds[view].step;
        let error = |x: usize, y: usize| match sample.truth[view].depth_at(y * width + x) {
            truth if truth > 0.0 => ((1.0 / depth[at(x, y)] - 1.0 / truth).abs() / step / WHITE_STEPS).min(1.0),
            _ => 0.0,
        };
        Ok(Panels {
            confidence: Grid::from_fn(width, height, |x, y| [confidence[at(x, y)]; 3]),
            depth: Grid::from_fn(width, height, |x, y| depth[at(x, y)]),
            normal: Grid::from_fn(width, height, |x, y| {
                normal_from_rotation(camera, x, y, surfels.rotations[at(x, y)])
            }),
            rendered: render(&SurfelSlices::from(&surfels), camera, &config)?.colour,
            error: Grid::from_fn(width, height, |x, y| [error(x, y); 3]),
        })
    };
    let panels = (0..sample.num_views()).map(panels).collect::<Result<Vec<_>, _>>()?;
    let truths: Vec<_> = sample.truth.iter().map(|truth| drawn(truth, width, height)).collect();
    let rows: Vec<PreviewRow> = panels
        .iter()
        .enumerate()
        .flat_map(|(view, panels)| {
            let truth = PreviewRow {
                photo: &sample.images[view],
                depth: &truths[view].0,
                believed: &truths[view].0,
                normal: &truths[view].1,
                last: &panels.confidence,
                captions: ["photo", "true depth", "true normals", "confidence"],
            };
            let prediction = PreviewRow {
                photo: &panels.rendered,
                depth: &panels.depth,
                believed: &truths[view].0,
                normal: &panels.normal,
                last: &panels.error,
                captions: ["rendering", "depth", "normals", "depth error"],
            };
            [truth, prediction]
        })
        .collect();
    Ok(write_atomically(path, |out| write_preview(out, &rows))?)
}

/// Depth and normals to draw; where they are not known, as where there are none.
fn drawn(truth: &ViewTruth, width: usize, height: usize) -> (Grid<f32>, Grid<[f32; 3]>) {
    let depth = truth.depth.as_ref().map_or_else(|| Grid::filled(width, height, 0.0), |depth| depth.map.clone());
    (depth, truth.normal.clone().unwrap_or_else(|| Grid::filled(width, height, [0.0; 3])))
}
