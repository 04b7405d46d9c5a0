//! How near and far the scene is from every view.
//!
//! Third step of the road. The range comes from the person, else from sparse points, else from the camera
//! file, else from triangulated matches, else from where the frusta overlap. Invariant: every view gets
//! `0 < near < far`, in scene units, with a sentence that says where they come from.

use super::cameras::SparseMatches;
use super::error::ReconstructError;
use super::input::Input;
use super::options::Options;
use super::progress::Log;
use glam::DVec3;
use surfel_core::{Camera, View};
use surfel_pair::{Match, Neighbour, bounds};

/// z-depth range of one view, scene units.
#[derive(Clone, Debug)]
pub struct Range {
    /// Nearest z-depth.
    pub near: f64,
    /// Farthest z-depth.
    pub far: f64,
    /// Where they come from.
    pub sentence: String,
    /// True when the photographs were measured, false when a person or a file stated the range.
    pub is_measured: bool,
}

/// The range of every view.
pub(crate) fn ranges(
    input: &Input,
    sparse: &SparseMatches,
    options: &Options,
    log: &Log,
) -> Result<Vec<Range>, ReconstructError> {
    let views = &input.views;
    let mut ranges = (0..views.len())
        .map(|v| range_of(input, v, &sparse.pairs, options))
        .collect::<Result<Vec<Range>, ReconstructError>>()?;
    widen_by_probe(views, &sparse.neighbours, &mut ranges, options);
    for (view, range) in views.iter().zip(&ranges) {
        log.say(format!("{}: depth {:.4} to {:.4}. {}", view.name, range.near, range.far, range.sentence));
    }
    Ok(ranges)
}

/// Widens measured ranges to what a dense look at thumbnails finds; stated ranges stay.
fn widen_by_probe(views: &[View], neighbours: &[Vec<usize>], ranges: &mut [Range], options: &Options) {
    if ranges.iter().all(|range| !range.is_measured) {
        return;
    }
    let measured: Vec<(f64, f64)> = ranges.iter().map(|r| (r.near, r.far)).collect();
    let found = super::depth::probe(views, neighbours, &measured, &options.matching);
    for (range, found) in ranges.iter_mut().zip(found) {
        if let (true, Some((near, far))) = (range.is_measured, found) {
            if near < range.near || far > range.far {
                range.sentence.push_str(" Widened by a dense look at thumbnails.");
            }
            range.near = options.near.unwrap_or(range.near.min(near));
            range.far = options.far.unwrap_or(range.far.max(far));
        }
    }
}

fn range_of(
    input: &Input,
    v: usize,
    pairs: &[(usize, usize, Vec<Match>)],
    options: &Options,
) -> Result<Range, ReconstructError> {
    let stated =
        input.scene.frames[input.frames[v]].near_far.filter(|(near, far)| *near > 0.0 && far > near && far.is_finite());
    let measured = || measured_range(input, v, pairs);
    let mut range = match (options.near, options.far) {
        (Some(near), Some(far)) => Range { near, far, sentence: "As asked.".to_owned(), is_measured: false },
        _ if input.scene.points.is_empty() && stated.is_some() => {
            let (near, far) = stated.unwrap_or_default();
            Range { near, far, sentence: "Stated by the camera file.".to_owned(), is_measured: false }
        }
        _ => measured()?,
    };
    range.near = options.near.unwrap_or(range.near);
    range.far = options.far.unwrap_or(range.far);
    if !(range.near > 0.0 && range.far > range.near && range.far.is_finite()) {
        return Err(ReconstructError::Choice(format!(
            "{}: the depth range {} to {} is empty; --near must be above 0 and below --far, in the unit of the camera file",
            input.views[v].name, range.near, range.far
        )));
    }
    Ok(range)
}

fn measured_range(input: &Input, v: usize, pairs: &[(usize, usize, Vec<Match>)]) -> Result<Range, ReconstructError> {
    let frame = input.frames[v] as u32;
    let seen = input.scene.points.iter().filter(|p| p.seen_by.is_empty() || p.seen_by.contains(&frame));
    let points: Vec<DVec3> = seen.map(|p| p.position).collect();
    let swapped: Vec<(usize, Vec<Match>)> = pairs
        .iter()
        .filter_map(|(a, b, matches)| match (*a == v, *b == v) {
            (true, _) => Some((*b, matches.clone())),
            (_, true) => Some((*a, matches.iter().map(Match::swapped).collect())),
            _ => None,
        })
        .collect();
    let cameras: Vec<(&Camera, &[Match])> =
        swapped.iter().map(|(n, m)| (&input.views[*n].camera, m.as_slice())).collect();
    let neighbours: Vec<Neighbour> = cameras.iter().map(|&(camera, matches)| Neighbour { camera, matches }).collect();
    let found = bounds(&input.views[v].camera, &points, &neighbours)
        .map_err(|source| ReconstructError::Range { views: input.names(), source })?;
    Ok(Range { near: found.near, far: found.far, sentence: found.sentence, is_measured: true })
}
