//! Which photographs to use when none is named, and which of them to match with which.
//!
//! The bridge from files to `surfel-pair`, which knows nothing of them: photographs are read only for the
//! few pairs worth verifying. Invariant: the reason returned names the photographs.

use super::error::ReconstructError;
use surfel_core::{Camera, View};
use surfel_io::ImageError;
use surfel_io::scene::{Frame, Scene};
use surfel_pair::{SparsePoint, choose_views};

/// Width of the photographs that a choice is verified on, pixels.
const PREVIEW_WIDTH: f64 = 480.0;

/// The best `count` photographs of a scene, reference first, and why.
pub fn choose(scene: &Scene, count: usize) -> Result<(Vec<usize>, String), ReconstructError> {
    let cameras: Vec<Camera> = scene.frames.iter().map(Frame::pinhole).collect();
    // A photograph that cannot be read is not the best one.
    let load = |index: usize| preview(&scene.frames[index]).ok();
    let choice = choose_views(&cameras, &sparse_points(scene), count, load).map_err(|error| {
        ReconstructError::Choice(format!("{}: {error}, or name the photographs with --views", scene.root.display()))
    })?;
    Ok((choice.views, choice.sentence))
}

/// For every view the views to match it with, best first, at most `count` and at least one.
pub fn neighbours(views: &[View], count: usize) -> Vec<Vec<usize>> {
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let of = |v: usize| match surfel_pair::neighbours(&cameras, &[], v, count) {
        // Cameras that see nothing in common are probably wrong, which only a look at the photographs can tell.
        none if none.is_empty() => (0..views.len()).filter(|&other| other != v).take(count).collect(),
        some => some,
    };
    (0..views.len()).map(of).collect()
}

/// A small view of a frame.
///
/// # Errors
/// As [`Frame::load`].
pub fn preview(frame: &Frame) -> Result<View, ImageError> {
    let scale = (PREVIEW_WIDTH / frame.width.max(frame.height) as f64).min(1.0);
    let side = |length: usize| ((length as f64 * scale).round() as usize).max(1);
    frame.load(side(frame.width), side(frame.height))
}

fn sparse_points(scene: &Scene) -> Vec<SparsePoint> {
    scene
        .points
        .iter()
        .map(|p| SparsePoint { position: p.position, seen_by: p.seen_by.iter().map(|&v| v as usize).collect() })
        .collect()
}
