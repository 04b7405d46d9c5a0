//! Sparse matches between the views: are the cameras right, and how near and far is the scene?
//!
//! Second step of the road. The range comes from the person, else from sparse points, else from the camera
//! file, else from triangulated matches, else from where the frusta overlap. Invariant: every view gets
//! `0 < near < far`, in scene units, with a sentence that says where they come from.

use super::error::ReconstructError;
use super::input::Input;
use super::options::Options;
use super::progress::Log;
use glam::DVec3;
use surfel_core::{Camera, View};
use surfel_pair::{Features, Match, Neighbour, Status, bounds, check_pair, match_features};

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

/// Verdict on one pair of views, for the report.
#[derive(Clone, Debug, serde::Serialize)]
pub struct PairCheck {
    /// Names of the two photographs.
    pub views: [String; 2],
    /// "Good", "Suspicious", ...
    pub status: String,
    /// Sparse matches between them.
    pub num_matches: usize,
    /// Matches that agree with the cameras.
    pub num_inliers: usize,
    /// Median distance to the epipolar lines, pixels of the working size.
    pub median_epipolar_px: Option<f64>,
    /// The verdict.
    pub sentence: String,
}

/// What the sparse matches told.
pub struct MatchedRange {
    /// Per view.
    pub ranges: Vec<Range>,
    /// Neighbours of every view, nearest first.
    pub neighbours: Vec<Vec<usize>>,
    /// Per pair of neighbours.
    pub checks: Vec<PairCheck>,
}

/// Most sources a view is matched against: the cost stays linear in the number of views.
const MAX_NEIGHBOURS: usize = 3;

impl MatchedRange {
    pub(crate) fn find(input: &Input, options: &Options, log: &Log) -> Result<Self, ReconstructError> {
        let views = &input.views;
        let neighbours = super::choice::neighbours(views, MAX_NEIGHBOURS);
        let features: Vec<Features> = views.iter().map(Features::of).collect();
        let matches = |a: usize, b: usize| match_features(&features[a], &features[b]);
        let mut pairs: Vec<(usize, usize, Vec<Match>)> = Vec::new();
        for (a, others) in neighbours.iter().enumerate() {
            for &b in others {
                if !pairs.iter().any(|p| (p.0, p.1) == (b, a)) {
                    pairs.push((a, b, matches(a, b)));
                }
            }
        }
        let checks = check_pairs(views, &pairs, options, log)?;
        let mut ranges = (0..views.len())
            .map(|v| range_of(input, v, &pairs, options))
            .collect::<Result<Vec<Range>, ReconstructError>>()?;
        widen_by_probe(views, &neighbours, &mut ranges, options);
        for (view, range) in views.iter().zip(&ranges) {
            log.say(format!("{}: depth {:.4} to {:.4}. {}", view.name, range.near, range.far, range.sentence));
        }
        Ok(Self { ranges, neighbours, checks })
    }
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

fn check_pairs(
    views: &[View],
    pairs: &[(usize, usize, Vec<Match>)],
    options: &Options,
    log: &Log,
) -> Result<Vec<PairCheck>, ReconstructError> {
    let mut checks = Vec::new();
    for (a, b, matches) in pairs {
        let verdict = check_pair(&views[*a].camera, &views[*b].camera, matches);
        let names = format!("{} and {}", views[*a].name, views[*b].name);
        match verdict.status {
            Status::Good => log.say(format!("{names}: {}", verdict.sentence)),
            Status::Wrong if !options.trust_cameras => {
                return Err(ReconstructError::Cameras {
                    views: names,
                    sentence: format!(
                        "{} Look at it with `surfelsplat inspect`; --trust-cameras goes on regardless.",
                        verdict.sentence
                    ),
                });
            }
            _ => log.warn(format!("{names}: {}", verdict.sentence)),
        }
        checks.push(PairCheck {
            views: [views[*a].name.clone(), views[*b].name.clone()],
            status: format!("{:?}", verdict.status),
            num_matches: verdict.num_matches,
            num_inliers: verdict.num_inliers,
            median_epipolar_px: verdict.median_epipolar_px,
            sentence: verdict.sentence,
        });
    }
    Ok(checks)
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
