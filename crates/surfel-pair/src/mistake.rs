//! The classic mistakes in camera files, each with the correction that undoes it.
//!
//! The hypotheses that [`crate::sanity`] tries when matches contradict the cameras. The invariant:
//! a correction is a pure function of one camera, so it can be handed straight to a reader.

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use surfel_core::{Camera, Intrinsics, Rigid};

/// Smaller focal lengths are no pixels; normalised ones are about 1.
pub(crate) const NORMALISED_FOCAL: f64 = 10.0;

/// A pose written in another convention than `camera_from_world` with OpenCV axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseMistake {
    /// Camera axes X right, Y up, Z back (OpenGL, Blender, NeRF).
    OpenGlAxes,
    /// The matrix goes the other way: camera-to-world where world-to-camera is meant, or the reverse.
    Inverse,
    /// The other way *and* OpenGL axes.
    InverseOpenGl,
    /// The rotation is transposed (row- against column-major, or of the other direction); the translation is right.
    TransposedRotation,
    /// The camera centre stands where the translation belongs.
    CentreAsTranslation,
    /// The translation was taken for the camera centre.
    TranslationAsCentre,
    /// The translation has the wrong sign.
    TranslationSign,
    /// Camera axes X down, Y right, Z back (LLFF `poses_bounds.npy`).
    LlffAxes,
    /// Camera axes X left, Y up (PyTorch3D); pictures turned upside down look the same.
    HalfTurn,
    /// The cameras, or the images, are in the wrong order.
    Exchanged,
}

/// Intrinsics that belong to another image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IntrinsicsMistake {
    /// Divided by the width and the height (RealEstate10K).
    Normalised,
    /// Of an image this many times as large.
    OtherResolution(f64),
    /// Of an image of other proportions, so many times as wide and as high.
    OtherProportions(f64, f64),
    /// Principal point given as (row, column).
    PrincipalPointSwapped,
}

/// What is wrong with a pair of cameras.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mistake {
    /// Only the poses.
    Pose(PoseMistake),
    /// Only the intrinsics.
    Intrinsics(IntrinsicsMistake),
    /// Both.
    Both(PoseMistake, IntrinsicsMistake),
}

impl PoseMistake {
    /// All of them, the likelier first: the order breaks ties.
    pub const ALL: [Self; 10] = [
        Self::OpenGlAxes,
        Self::Inverse,
        Self::InverseOpenGl,
        Self::CentreAsTranslation,
        Self::TranslationAsCentre,
        Self::TransposedRotation,
        Self::TranslationSign,
        Self::HalfTurn,
        Self::LlffAxes,
        Self::Exchanged,
    ];

    /// What was meant, if this is what went wrong.
    ///
    /// [`Self::Exchanged`] concerns two cameras and leaves one alone.
    pub fn corrected(self, given: &Rigid) -> Rigid {
        let turned = |axes: DMat3, pose: &Rigid| Rigid { rotation: axes, translation: DVec3::ZERO } * *pose;
        let opengl = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let Rigid { rotation, translation } = *given;
        match self {
            Self::OpenGlAxes => turned(opengl, given),
            Self::Inverse => given.inverse(),
            Self::InverseOpenGl => turned(opengl, &given.inverse()),
            Self::TransposedRotation => Rigid { rotation: rotation.transpose(), translation },
            Self::CentreAsTranslation => Rigid { rotation, translation: -(rotation * translation) },
            Self::TranslationAsCentre => Rigid { rotation, translation: -(rotation.transpose() * translation) },
            Self::TranslationSign => Rigid { rotation, translation: -translation },
            // Right = second axis, down = first, forward = minus third.
            Self::LlffAxes => turned(DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::NEG_Z), given),
            Self::HalfTurn => turned(DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)), given),
            Self::Exchanged => *given,
        }
    }

    /// What the mistake is called in a sentence: "the poses are probably ...".
    fn description(self) -> &'static str {
        match self {
            Self::OpenGlAxes => "the poses are probably OpenGL (Y up, Z back). Pass --axes opengl or fix the file",
            Self::Inverse => {
                "the poses are probably the inverse of what they are read as (camera-to-world against world-to-camera). \
                 Invert the matrices"
            }
            Self::InverseOpenGl => {
                "the poses are probably OpenGL camera-to-world matrices read as world-to-camera. \
                 Invert the matrices and pass --axes opengl"
            }
            Self::TransposedRotation => {
                "the rotations are probably transposed (row- against column-major order). Transpose the 3x3 parts"
            }
            Self::CentreAsTranslation => {
                "the camera centres probably stand where the translations belong. Write t = -R C"
            }
            Self::TranslationAsCentre => {
                "the translations were probably taken for camera centres. Write t itself, not -R t"
            }
            Self::TranslationSign => "the translations probably have the wrong sign. Negate them",
            Self::LlffAxes => "the axes are probably those of LLFF (X down, Y right, Z back). Pass --axes llff",
            Self::HalfTurn => {
                "the camera axes are probably X left, Y up (PyTorch3D), or the images are upside down. \
                 Turn the axes or the images by 180 degrees"
            }
            Self::Exchanged => "the two cameras or the two images are probably exchanged. Check their order",
        }
    }

    /// The convention in two or three words: "with OpenGL axes ...".
    fn label(self) -> &'static str {
        match self {
            Self::OpenGlAxes => "OpenGL axes (Y up, Z back)",
            Self::Inverse => "inverted poses",
            Self::InverseOpenGl => "inverted poses and OpenGL axes",
            Self::TransposedRotation => "transposed rotations",
            Self::CentreAsTranslation => "the translations read as camera centres",
            Self::TranslationAsCentre => "the camera centres read as translations",
            Self::TranslationSign => "negated translations",
            Self::LlffAxes => "LLFF axes (X down, Y right, Z back)",
            Self::HalfTurn => "the images turned by 180 degrees",
            Self::Exchanged => "the two cameras exchanged",
        }
    }
}

impl IntrinsicsMistake {
    /// The mistakes worth trying on these intrinsics, the likelier first.
    pub fn candidates(given: &Intrinsics, width: usize, height: usize) -> Vec<Self> {
        if given.fx.abs() < NORMALISED_FOCAL && given.fy.abs() < NORMALISED_FOCAL {
            return vec![Self::Normalised];
        }
        let mut candidates: Vec<Self> = [2.0, 4.0, 0.5, 0.25].map(Self::OtherResolution).into();
        match Self::of_principal_point(given, width, height) {
            // The principal point is only about the centre of its image.
            Some(Self::OtherResolution(factor)) => candidates
                .extend((-8..=8).map(|percent| Self::OtherResolution(factor * (1.0 + 0.01 * f64::from(percent))))),
            other => candidates.extend(other),
        }
        candidates.push(Self::PrincipalPointSwapped);
        candidates
    }

    /// The image size of which the principal point would be the centre, unless it is the centre already.
    pub(crate) fn of_principal_point(given: &Intrinsics, width: usize, height: usize) -> Option<Self> {
        let (across, down) = (given.cx / (0.5 * width as f64), given.cy / (0.5 * height as f64));
        if !(across > 0.0 && down > 0.0) {
            return None;
        }
        let factor = (across * down).sqrt();
        let is_alike = (across / down).ln().abs() < 0.2;
        match is_alike {
            true => (factor.ln().abs() > 0.1).then_some(Self::OtherResolution(factor)),
            false => Some(Self::OtherProportions(across, down)),
        }
    }

    /// What was meant, if this is what went wrong.
    pub fn corrected(self, given: &Intrinsics, width: usize, height: usize) -> Intrinsics {
        let scaled =
            |x: f64, y: f64| Intrinsics { fx: given.fx * x, fy: given.fy * y, cx: given.cx * x, cy: given.cy * y };
        match self {
            Self::Normalised => scaled(width as f64, height as f64),
            Self::OtherResolution(factor) => scaled(1.0 / factor, 1.0 / factor),
            Self::OtherProportions(across, down) => scaled(1.0 / across, 1.0 / down),
            Self::PrincipalPointSwapped => Intrinsics { cx: given.cy, cy: given.cx, ..*given },
        }
    }

    fn description(self, width: usize, height: usize) -> String {
        let size = |x: f64, y: f64| format!("{:.0} x {:.0}", width as f64 * x, height as f64 * y);
        match self {
            Self::Normalised => "the intrinsics are probably normalised. Multiply fx, cx by the width and fy, cy by \
                                 the height"
                .into(),
            Self::OtherResolution(f) => format!(
                "the intrinsics probably belong to an image of about {} ({f:.2} times as large as {}). State that size \
                 beside them, or scale fx, fy, cx, cy by {:.3}",
                size(f, f),
                size(1.0, 1.0),
                1.0 / f
            ),
            Self::OtherProportions(x, y) => format!(
                "the intrinsics probably belong to an image of about {} (here: {}). State that size beside them, or \
                 scale fx, cx by {:.3} and fy, cy by {:.3}",
                size(x, y),
                size(1.0, 1.0),
                1.0 / x,
                1.0 / y
            ),
            Self::PrincipalPointSwapped => {
                "the principal point is probably given as (row, column). Exchange cx and cy".into()
            }
        }
    }

    fn label(self) -> String {
        match self {
            Self::Normalised => "intrinsics multiplied by the image size".into(),
            Self::OtherResolution(f) => format!("intrinsics scaled by {:.3}", 1.0 / f),
            Self::OtherProportions(x, y) => format!("intrinsics scaled by {:.3} and {:.3}", 1.0 / x, 1.0 / y),
            Self::PrincipalPointSwapped => "cx and cy exchanged".into(),
        }
    }
}

impl Mistake {
    /// Both cameras as they were meant, if this is what went wrong with both.
    pub fn corrected_pair(self, a: &Camera, b: &Camera) -> (Camera, Camera) {
        let (pose, intrinsics) = match self {
            Self::Pose(pose) => (Some(pose), None),
            Self::Intrinsics(intrinsics) => (None, Some(intrinsics)),
            Self::Both(pose, intrinsics) => (Some(pose), Some(intrinsics)),
        };
        let fixed = |camera: &Camera| Camera {
            camera_from_world: pose
                .map_or(camera.camera_from_world, |mistake| mistake.corrected(&camera.camera_from_world)),
            intrinsics: intrinsics.map_or(camera.intrinsics, |mistake| {
                mistake.corrected(&camera.intrinsics, camera.width, camera.height)
            }),
            ..*camera
        };
        match pose {
            Some(PoseMistake::Exchanged) => {
                let (a, b) = (fixed(a), fixed(b));
                let (pose_a, pose_b) = (a.camera_from_world, b.camera_from_world);
                (Camera { camera_from_world: pose_b, ..a }, Camera { camera_from_world: pose_a, ..b })
            }
            _ => (fixed(a), fixed(b)),
        }
    }

    /// True for another kind of mistake that is no more complicated.
    pub(crate) fn is_simple_alternative_to(self, best: Self) -> bool {
        let same_kind = match (self, best) {
            (Self::Pose(p), Self::Pose(q)) => p == q,
            (Self::Intrinsics(p), Self::Intrinsics(q)) => std::mem::discriminant(&p) == std::mem::discriminant(&q),
            (Self::Both(p, _), Self::Both(q, _)) => p == q,
            _ => false,
        };
        !same_kind && (!matches!(self, Self::Both(..)) || matches!(best, Self::Both(..)))
    }

    /// What is probably wrong and what to do about it, as the rest of a sentence; `camera` states the image size.
    pub fn description(self, camera: &Camera) -> String {
        let (width, height) = (camera.width, camera.height);
        match self {
            Self::Pose(pose) => pose.description().into(),
            Self::Intrinsics(intrinsics) => intrinsics.description(width, height),
            Self::Both(pose, intrinsics) => {
                format!("{}; and {}", pose.description(), intrinsics.description(width, height))
            }
        }
    }

    /// The corrected convention in a few words.
    pub fn label(self) -> String {
        match self {
            Self::Pose(pose) => pose.label().into(),
            Self::Intrinsics(intrinsics) => intrinsics.label(),
            Self::Both(pose, intrinsics) => format!("{} and {}", pose.label(), intrinsics.label()),
        }
    }
}
