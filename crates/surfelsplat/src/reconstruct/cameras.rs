//! Sparse matches between the views: can the cameras be right, and do they look where they are said to?
//!
//! Second step of the road. Cameras that the photographs contradict stop it; cameras that miss by a pixel or two, as
//! those of trackers do, are turned until the matches meet their epipolar lines. Invariant: cameras that the matches
//! agree with, and those of a person who trusts them, leave as they came.

use super::error::ReconstructError;
use super::options::Options;
use super::progress::Log;
use surfel_core::{Camera, View};
use surfel_pair::{Features, Match, PairMatches, Status, Verdict, check_pair, match_features, turned};

/// Most sources a view is matched against: the cost stays linear in the number of views.
const MAX_NEIGHBOURS: usize = 3;

/// What keypoints say of the views.
pub struct SparseMatches {
    /// Neighbours of every view, nearest first.
    pub neighbours: Vec<Vec<usize>>,
    /// Two views, the lower index of a pair that was asked for both ways first, and what both see.
    pub pairs: Vec<(usize, usize, Vec<Match>)>,
}

impl SparseMatches {
    /// Matches every view with its neighbours.
    pub fn between(views: &[View]) -> Self {
        let neighbours = super::choice::neighbours(views, MAX_NEIGHBOURS);
        let features: Vec<Features> = views.iter().map(Features::of).collect();
        let mut pairs: Vec<(usize, usize, Vec<Match>)> = Vec::new();
        for (a, others) in neighbours.iter().enumerate() {
            for &b in others {
                if !pairs.iter().any(|p| (p.0, p.1) == (b, a)) {
                    pairs.push((a, b, match_features(&features[a], &features[b])));
                }
            }
        }
        Self { neighbours, pairs }
    }
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

/// How the cameras were turned, for the report.
#[derive(Clone, Debug, serde::Serialize)]
pub struct CameraTurn {
    /// How far the camera that turned most has turned, degrees.
    pub most_deg: f64,
    /// Median distance to the epipolar lines before, pixels of the working size, of the matches that agree after.
    pub median_epipolar_px_before: f64,
    /// The same after.
    pub median_epipolar_px_after: f64,
    /// Matches that agree after.
    pub num_agreeing: usize,
}

/// What became of the cameras.
pub struct Checked {
    /// Verdicts on the cameras that are used, per pair of neighbours.
    pub checks: Vec<PairCheck>,
    /// How they were turned; `None` if they were not.
    pub turn: Option<CameraTurn>,
}

/// Judges the cameras of the views, and turns them where that mends a noticeable miss.
///
/// # Errors
/// [`ReconstructError::Cameras`] where the photographs contradict the cameras, unless these are to be trusted.
pub(crate) fn check(
    views: &mut [View],
    sparse: &SparseMatches,
    options: &Options,
    log: &Log,
) -> Result<Checked, ReconstructError> {
    let given = verdicts(views, sparse);
    if let Some((pair, verdict)) = given.iter().find(|(_, verdict)| verdict.status == Status::Wrong)
        && !options.trust_cameras
    {
        return Err(ReconstructError::Cameras {
            views: pair.join(" and "),
            sentence: format!(
                "{} Look at it with `surfelsplat inspect`; --trust-cameras goes on regardless.",
                verdict.sentence
            ),
        });
    }
    let turn = if options.trust_cameras { None } else { turn(views, sparse) };
    if let Some(turn) = &turn {
        log.warn(format!(
            "the cameras look {:.1} px past what the photographs show (median of {} matches); turned by up to {:.2} degrees \
             they miss by {:.1} px. --trust-cameras leaves them as they are",
            turn.median_epipolar_px_before, turn.num_agreeing, turn.most_deg, turn.median_epipolar_px_after
        ));
    }
    let used = if turn.is_some() { verdicts(views, sparse) } else { given };
    for (pair, verdict) in &used {
        let line = format!("{}: {}", pair.join(" and "), verdict.sentence);
        if verdict.status == Status::Good { log.say(line) } else { log.warn(line) }
    }
    Ok(Checked { checks: used.into_iter().map(|(pair, verdict)| PairCheck::of(pair, verdict)).collect(), turn })
}

fn turn(views: &mut [View], sparse: &SparseMatches) -> Option<CameraTurn> {
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let pairs: Vec<PairMatches> =
        sparse.pairs.iter().map(|(a, b, matches)| PairMatches { a: *a, b: *b, matches }).collect();
    let turned = turned(&cameras, &pairs)?;
    views.iter_mut().zip(&turned.cameras).for_each(|(view, camera)| view.camera = *camera);
    Some(CameraTurn {
        most_deg: turned.most_deg,
        median_epipolar_px_before: turned.median_px.0,
        median_epipolar_px_after: turned.median_px.1,
        num_agreeing: turned.num_agreeing,
    })
}

fn verdicts(views: &[View], sparse: &SparseMatches) -> Vec<([String; 2], Verdict)> {
    let of = |(a, b, matches): &(usize, usize, Vec<Match>)| {
        let names = [*a, *b].map(|v| views[v].name.clone());
        (names, check_pair(&views[*a].camera, &views[*b].camera, matches))
    };
    sparse.pairs.iter().map(of).collect()
}

impl PairCheck {
    fn of(views: [String; 2], verdict: Verdict) -> Self {
        Self {
            views,
            status: format!("{:?}", verdict.status),
            num_matches: verdict.num_matches,
            num_inliers: verdict.num_inliers,
            median_epipolar_px: verdict.median_epipolar_px,
            sentence: verdict.sentence,
        }
    }
}
