//! Can these cameras be right, and if not, which of the classic mistakes is it?
//!
//! Matches found without any camera are the witness: first they are asked whether they agree among
//! themselves ([`mod@crate::consensus`]), then whether they agree with the given cameras, and if not, with
//! the cameras as corrected for every classic mistake. The invariant: cameras that explain the matches are
//! never called wrong, and without enough matches nothing is claimed.

use crate::consensus::consensus;
use crate::epipolar::{EpipolarGeometry, inlier_distance, median};
use crate::mistake::{IntrinsicsMistake, Mistake, PoseMistake};
use crate::plausible::{Oddity, axes_diverge, oddities, principal_offset};
use crate::triangulate::{Side, side};
use crate::turn::{PairMatches, Turned, turned};
use crate::{Match, frustum};
use serde::{Deserialize, Serialize};
use surfel_core::Camera;

/// Share of the rigid matches that cameras must explain to be believed. Poses of a phone's tracker
/// explain nine in ten, cameras of another convention less than a third.
const BELIEVED: f64 = 0.7;
/// Cameras whose median match misses by this many inlier distances are no longer just inaccurate.
const FAR_OFF: f64 = 4.0;
/// A correction must explain the matches this many times as well as the given cameras, see [`Support::merit`].
const CLEARLY_BETTER: f64 = 1.6;
/// Explanations this close to the best are as good as the best.
const AS_GOOD: f64 = 0.97;

/// So many matches do not lie on their epipolar lines by chance.
const MIN_AGREEING: usize = 10;

/// Offset of the principal point, in shares of the image side, from which a second look is worth it: half-size
/// intrinsics put it at a quarter.
const SUSPICIOUS_OFFSET: f64 = 0.2;

/// How far the cameras of a pair can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// The matches agree with the cameras.
    Good,
    /// Something does not fit, but not enough to call it wrong.
    Suspicious,
    /// The matches contradict the cameras, or the cameras cannot give depth.
    Wrong,
    /// Too few matches to say.
    CannotTell,
}

/// What the check found, for people and for programs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// How far the cameras can be trusted.
    pub status: Status,
    /// The mistake that explains the matches best, if one does clearly better than the given cameras.
    pub likely_cause: Option<Mistake>,
    /// Other mistakes that explain the matches as well.
    pub also_possible: Vec<Mistake>,
    /// Median distance of the rigid matches to the epipolar lines of the given cameras, pixels.
    pub median_epipolar_px: Option<f64>,
    /// Matches that were shown.
    pub num_matches: usize,
    /// Matches on their epipolar line and in front of both given cameras.
    pub num_inliers: usize,
    /// The finding in one or two sentences, with what to do.
    pub sentence: String,
}

/// Judges two cameras by sparse matches between their images, best match first (as
/// [`crate::match_views`] returns them). Never fails: too few matches give [`Status::CannotTell`].
pub fn check_pair(a: &Camera, b: &Camera, matches: &[Match]) -> Verdict {
    let matches: Vec<Match> = matches.iter().filter(|m| m.a.is_finite() && m.b.is_finite()).copied().collect();
    let oddities = oddities(a, b);
    let unjudged = Verdict {
        status: Status::CannotTell,
        likely_cause: None,
        also_possible: Vec::new(),
        median_epipolar_px: None,
        num_matches: matches.len(),
        num_inliers: 0,
        sentence: "Too few reliable matches between the views to judge the cameras.".into(),
    };
    if let Some(oddity @ Oddity::NotACamera) = oddities.first() {
        return Verdict { status: Status::Wrong, sentence: oddity.sentence(), ..unjudged };
    }
    // A wrong but self-consistent clique of matches must not speak against cameras that explain more.
    let inliers = Support::of(a, b, &matches);
    let unjudged = Verdict { num_inliers: inliers.count, median_epipolar_px: inliers.median_px, ..unjudged };
    let Some(rigid) = consensus(&matches, inlier_distance(a, b)) else {
        let is_enough = inliers.count >= MIN_AGREEING && 2 * inliers.count >= matches.len();
        return if is_enough {
            believed(a, b, &matches, &inliers, unjudged)
        } else {
            without_witness(a, b, &oddities, unjudged)
        };
    };
    let witnesses: Vec<Match> = rigid.inliers.iter().map(|&i| matches[i]).collect();
    let given = Support::of(a, b, &witnesses);
    let base = Verdict { median_epipolar_px: given.median_px, ..unjudged };

    let believable = BELIEVED * witnesses.len() as f64;
    // Poses that are a little off are likelier than a mistake that explains the matches no better.
    let turned = turned(&[*a, *b], &[PairMatches { a: 0, b: 1, matches: &witnesses }]);
    let merit_turned = turned.as_ref().map_or(0.0, |t| Support::of(&t.cameras[0], &t.cameras[1], &witnesses).merit());
    let explanations = explanations(a, b, &witnesses);
    let best = &explanations[0];
    let is_explained = best.support.count as f64 >= believable;
    if is_explained && best.support.merit() >= CLEARLY_BETTER * inliers.merit().max(merit_turned) {
        let complaint = complaint(a, b, &oddities, &given, witnesses.len());
        return explained(a, &explanations, &complaint, witnesses.len(), base);
    }
    if inliers.count as f64 >= believable {
        return believed(a, b, &witnesses, &inliers, base);
    }
    unexplained(a, b, &oddities, &given, turned.as_ref(), witnesses.len(), base)
}

/// How well a pair of cameras explains some matches.
#[derive(Clone, Copy, Debug)]
struct Support {
    /// On their epipolar line and not behind a camera.
    count: usize,
    /// On their epipolar line but behind a camera.
    behind: usize,
    /// Median distance of all, pixels.
    median_px: Option<f64>,
    /// Median distance of those that count, pixels.
    inlier_px: Option<f64>,
}

impl Support {
    fn of(a: &Camera, b: &Camera, matches: &[Match]) -> Self {
        let Some(geometry) = EpipolarGeometry::of(a, b) else {
            return Self { count: 0, behind: 0, median_px: None, inlier_px: None };
        };
        let limit = inlier_distance(a, b);
        let distances: Vec<f64> = matches.iter().map(|m| geometry.distance(m)).collect();
        let on_line = || (0..matches.len()).filter(|&i| distances[i] < limit);
        let (behind, front): (Vec<usize>, Vec<usize>) =
            on_line().partition(|&i| side(a, b, &matches[i]) == Side::Behind);
        Self {
            count: front.len(),
            behind: behind.len(),
            inlier_px: median(front.iter().map(|&i| distances[i]).collect()),
            median_px: median(distances),
        }
    }
}

impl Support {
    /// Matches explained, each worth more the closer it is; a fit to a quarter of a pixel is as good as a perfect one.
    fn merit(&self) -> f64 {
        self.count as f64 / (0.5 + self.inlier_px.unwrap_or(f64::INFINITY)).max(0.75)
    }
}

struct Explanation {
    mistake: Mistake,
    support: Support,
}

/// Every hypothesis, the best first. Equal support goes to the more exact, then to the simpler and likelier.
fn explanations(a: &Camera, b: &Camera, witnesses: &[Match]) -> Vec<Explanation> {
    let of_intrinsics = IntrinsicsMistake::candidates(&a.intrinsics, a.width, a.height);
    let single =
        PoseMistake::ALL.map(Mistake::Pose).into_iter().chain(of_intrinsics.iter().map(|&i| Mistake::Intrinsics(i)));
    let double = PoseMistake::ALL
        .into_iter()
        .flat_map(|pose| of_intrinsics.iter().map(move |&intrinsics| Mistake::Both(pose, intrinsics)));
    let mut tried: Vec<Explanation> = single
        .chain(double)
        .map(|mistake| {
            let (a, b) = mistake.corrected_pair(a, b);
            Explanation { mistake, support: Support::of(&a, &b, witnesses) }
        })
        .collect();
    // Two mistakes at once must earn it.
    let merit = |e: &Explanation| if matches!(e.mistake, Mistake::Both(..)) { 0.9 } else { 1.0 } * e.support.merit();
    tried.sort_by(|p, q| merit(q).total_cmp(&merit(p)));
    tried
}

/// A classic mistake explains the matches: name it and what to do.
fn explained(
    a: &Camera,
    explanations: &[Explanation],
    complaint: &str,
    num_witnesses: usize,
    base: Verdict,
) -> Verdict {
    let best = &explanations[0];
    let sentence = format!(
        "{complaint}; with {} {} of {num_witnesses} matches agree to {:.1} px: {}.",
        best.mistake.label(),
        best.support.count,
        best.support.inlier_px.unwrap_or(0.0),
        best.mistake.description(a),
    );
    let rivals = explanations[1..].iter().filter(|e| e.support.merit() >= AS_GOOD * best.support.merit());
    let also_possible =
        rivals.map(|e| e.mistake).filter(|rival| rival.is_simple_alternative_to(best.mistake)).collect();
    Verdict { status: Status::Wrong, likely_cause: Some(best.mistake), also_possible, sentence, ..base }
}

/// The matches agree with each other, but with no camera we can think of.
fn unexplained(
    a: &Camera,
    b: &Camera,
    oddities: &[Oddity],
    given: &Support,
    turned: Option<&Turned>,
    num_witnesses: usize,
    base: Verdict,
) -> Verdict {
    if let Some(oddity @ Oddity::NoBaseline) = oddities.first() {
        return Verdict { status: Status::Wrong, sentence: oddity.sentence(), ..base };
    }
    let miss_px = given.median_px.unwrap_or(f64::INFINITY);
    let is_far_off = miss_px > FAR_OFF * inlier_distance(a, b) || given.behind > given.count;
    let (status, reason) = if is_far_off {
        (Status::Wrong, "the cameras may belong to other images, or their convention is unknown")
    } else {
        (Status::Suspicious, "the poses or the intrinsics are inaccurate")
    };
    let complaint = complaint(a, b, oddities, given, num_witnesses);
    let remedy = turned.map_or(String::new(), |turned| {
        let Turned { most_deg, median_px: (_, remaining), .. } = turned;
        format!(" Turned by {most_deg:.2} degrees where they stand they miss by {remaining:.1} px.")
    });
    let sentence = format!("{complaint}, and no known mistake of convention explains it: {reason}.{remedy}");
    Verdict { status, sentence, ..base }
}

/// The first half of a bad verdict: what does not fit.
fn complaint(a: &Camera, b: &Camera, oddities: &[Oddity], given: &Support, num_witnesses: usize) -> String {
    if let Some(oddity) = oddities.first() {
        return oddity.sentence().trim_end_matches('.').to_string();
    }
    if given.behind > given.count && 2 * given.behind > num_witnesses {
        return format!("{} of {num_witnesses} matches lie behind the cameras", given.behind);
    }
    let distance = given.median_px.unwrap_or(f64::INFINITY);
    // Views may well look outwards: worth saying only when they are far from right.
    if distance > FAR_OFF * inlier_distance(a, b) && axes_diverge(a, b) {
        return "The cameras look away from each other".into();
    }
    format!("The matches miss their epipolar lines by {distance:.1} px (median of {num_witnesses})")
}

/// Cameras that explain the matches: good, unless the intrinsics are odd and a correction explains them as well.
fn believed(a: &Camera, b: &Camera, witnesses: &[Match], inliers: &Support, base: Verdict) -> Verdict {
    let agree = format!(
        "{} of {} matches agree with the cameras to {:.1} px",
        inliers.count,
        base.num_matches,
        inliers.inlier_px.unwrap_or(0.0)
    );
    if principal_offset(a).max(principal_offset(b)) > SUSPICIOUS_OFFSET {
        let rival = resolution_of_principal_point(a).map(Mistake::Intrinsics).filter(|mistake| {
            let (a, b) = mistake.corrected_pair(a, b);
            Support::of(&a, &b, witnesses).count as f64 >= AS_GOOD * inliers.count as f64
        });
        if let Some(mistake) = rival {
            let sentence = format!(
                "{agree}, but the principal point is far from the image centre and they agree as well with {}: {}, \
                 unless the image was cropped.",
                mistake.label(),
                mistake.description(a)
            );
            return Verdict { status: Status::Suspicious, likely_cause: Some(mistake), sentence, ..base };
        }
    }
    Verdict { status: Status::Good, sentence: format!("{agree}."), ..base }
}

/// The image size whose centre the principal point would be.
fn resolution_of_principal_point(camera: &Camera) -> Option<IntrinsicsMistake> {
    IntrinsicsMistake::of_principal_point(&camera.intrinsics, camera.width, camera.height)
}

/// Too few matches: only geometry can speak.
fn without_witness(a: &Camera, b: &Camera, oddities: &[Oddity], unjudged: Verdict) -> Verdict {
    let Some(&oddity) = oddities.first() else { return unjudged };
    if oddity == Oddity::NoBaseline {
        return Verdict { status: Status::Wrong, sentence: oddity.sentence(), ..unjudged };
    }
    let hint = match oddity {
        Oddity::NothingInCommon => Some(Mistake::Pose(PoseMistake::OpenGlAxes)),
        Oddity::Normalised => Some(Mistake::Intrinsics(IntrinsicsMistake::Normalised)),
        Oddity::PrincipalPoint(_) => resolution_of_principal_point(a).map(Mistake::Intrinsics),
        _ => None,
    };
    let hint = hint.filter(|mistake| {
        let (a, b) = mistake.corrected_pair(a, b);
        frustum::overlap(&a, &b, 0.0, f64::INFINITY) > 0.3
    });
    let sentence = match hint {
        Some(mistake) => format!(
            "{} Too few matches to be sure, but with {} they would fit: {}.",
            oddity.sentence(),
            mistake.label(),
            mistake.description(a)
        ),
        None => format!("{} There are too few matches to say more.", oddity.sentence()),
    };
    Verdict { status: Status::Suspicious, likely_cause: hint, sentence, ..unjudged }
}
