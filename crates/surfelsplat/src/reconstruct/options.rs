//! What a person may choose about a reconstruction; everything left `None` is chosen from the data and reported.

use crate::reconstruct::solid::LeastConfidence;
use crate::reconstruct::surfels::SurfelConfig;
use std::sync::Arc;
use surfel_io::scene::{FormatKind, Scene};
use surfel_net::SurfelNet;
use surfel_pair::PoseMistake;
use surfel_stereo::MatchConfig;

/// Choices of one reconstruction. Lengths are in scene units.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Names, stems or numbers of the photographs to use; empty = choose.
    pub views: Vec<String>,
    /// How many photographs to choose when none is named (at least 2).
    pub num_views: Option<usize>,
    /// Working width and height in pixels.
    pub size: Option<(usize, usize)>,
    /// The format of the cameras, when detection should not decide.
    pub format: Option<FormatKind>,
    /// The axes of the cameras, when they are not those the format promises.
    pub axes: Option<Axes>,
    /// Nearest z-depth.
    pub near: Option<f64>,
    /// Farthest z-depth.
    pub far: Option<f64>,
    /// Edge of a voxel of the mesh.
    pub voxel: Option<f64>,
    /// Components of the mesh to keep.
    pub keep_components: Option<usize>,
    /// Take the cameras as they are: go on although the photographs contradict them, and turn none of them.
    pub trust_cameras: bool,
    /// How depth is found.
    pub depth: DepthSource,
    /// Matching.
    pub matching: MatchConfig,
    /// Surfels.
    pub surfels: SurfelConfig,
}

/// How depth is found.
#[derive(Clone, Debug, Default)]
pub enum DepthSource {
    /// Plane sweep and slanted refinement.
    #[default]
    Matching,
    /// Matching, refined by this network, whose surfels are used.
    Network(Arc<SurfelNet>),
}

impl DepthSource {
    /// Confidence below which a pixel's depth enters no mesh: a hole rather than a lie. Where it is not learned it is no
    /// probability; leaving pixels out by it then costs more surface than it mends, and tells no ground from an edge.
    pub fn least_confidence(&self) -> LeastConfidence {
        match self {
            Self::Matching => LeastConfidence { anywhere: 0.0, grazing: f32::INFINITY },
            Self::Network(_) => LeastConfidence { anywhere: 0.2, grazing: 0.5 },
        }
    }

    /// The name used on the command line and in reports.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Matching => "matching",
            Self::Network(_) => "network",
        }
    }
}

/// Camera axes that poses are written in although their format promises others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// X right, Y up, Z back.
    OpenGl,
    /// X down, Y right, Z back.
    Llff,
}

impl Axes {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::OpenGl, Self::Llff];

    /// The short name used on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::OpenGl => "opengl",
            Self::Llff => "llff",
        }
    }

    /// Turns the cameras of a scene to OpenCV axes; where they stand does not change.
    pub fn turn(self, scene: &mut Scene) {
        let mistake = match self {
            Self::OpenGl => PoseMistake::OpenGlAxes,
            Self::Llff => PoseMistake::LlffAxes,
        };
        for frame in &mut scene.frames {
            frame.camera_from_world = mistake.corrected(&frame.camera_from_world);
        }
    }
}
