//! The camera formats by name, and the sentence that says which one was found.
//!
//! The order of [`FormatKind::ALL`] is the order of preference when a folder holds several.

use std::fmt;
use std::path::PathBuf;

/// A way in which people write down the cameras of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FormatKind {
    /// COLMAP sparse model, binary or text.
    Colmap,
    /// nerfstudio, instant-ngp and Blender `transforms*.json`.
    Transforms,
    /// IDR / NeuS `cameras*.npz` with `world_mat_i`.
    Idr,
    /// robustmvd `cameras.npz` with `K` and `to_ref_transform`.
    RobustMvd,
    /// MVSNet, BlendedMVS and DTU `*_cam.txt`.
    MvsNet,
    /// LLFF `poses_bounds.npy`.
    Llff,
    /// RealEstate10K text.
    RealEstate10k,
    /// The project's own `cameras.json`.
    CamerasJson,
    /// Middlebury multi-view `*_par.txt`.
    Middlebury,
    /// Strecha et al. `*.camera`.
    Strecha,
    /// Middlebury stereo and ETH3D two-view `calib.txt`.
    StereoCalib,
    /// `poses.txt` and `K.txt`.
    PosesText,
    /// Open3D / Redwood `trajectory.log`.
    TrajectoryLog,
}

impl FormatKind {
    /// Every format, the preferred one first.
    pub const ALL: [Self; 13] = [
        Self::Colmap,
        Self::Transforms,
        Self::Idr,
        Self::RobustMvd,
        Self::MvsNet,
        Self::Llff,
        Self::RealEstate10k,
        Self::CamerasJson,
        Self::Middlebury,
        Self::Strecha,
        Self::StereoCalib,
        Self::PosesText,
        Self::TrajectoryLog,
    ];

    /// The short name used on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Colmap => "colmap",
            Self::Transforms => "transforms",
            Self::Idr => "idr",
            Self::RobustMvd => "robustmvd",
            Self::MvsNet => "mvsnet",
            Self::Llff => "llff",
            Self::RealEstate10k => "re10k",
            Self::CamerasJson => "cameras-json",
            Self::Middlebury => "middlebury",
            Self::Strecha => "strecha",
            Self::StereoCalib => "stereo-calib",
            Self::PosesText => "poses-txt",
            Self::TrajectoryLog => "trajectory-log",
        }
    }

    /// The files it is recognised by.
    pub fn files(self) -> &'static str {
        match self {
            Self::Colmap => "sparse/0, sparse or colmap/sparse/0 with cameras and images, .bin or .txt",
            Self::Transforms => "transforms.json, transforms_train.json (nerfstudio, instant-ngp, Blender)",
            Self::Idr => "cameras.npz or cameras_sphere.npz with world_mat_0 (IDR, NeuS)",
            Self::RobustMvd => "cameras.npz with K and to_ref_transform",
            Self::MvsNet => "cams/00000000_cam.txt (MVSNet, BlendedMVS, DTU)",
            Self::Llff => "poses_bounds.npy",
            Self::RealEstate10k => "<clip>.txt with 19 numbers a line",
            Self::CamerasJson => "cameras.json with image, K and camera_from_world",
            Self::Middlebury => "<name>_par.txt",
            Self::Strecha => "<image>.camera",
            Self::StereoCalib => "calib.txt with cam0, cam1 and baseline (Middlebury stereo, ETH3D two-view)",
            Self::PosesText => "poses.txt and K.txt",
            Self::TrajectoryLog => "trajectory.log (Open3D, Redwood), with intrinsic.json",
        }
    }
}

impl fmt::Display for FormatKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for FormatKind {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::name).join(", ");
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == name)
            .ok_or_else(|| format!("{name:?} is no camera format; known are {}", known()))
    }
}

/// One line per format: its name and the files it is recognised by.
pub fn list_formats() -> String {
    FormatKind::ALL.map(|kind| format!("  {:<15} {}", kind.name(), kind.files())).join("\n")
}

/// What was found in a folder; its `Display` is the sentence to say aloud.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFormat {
    /// The format.
    pub kind: FormatKind,
    /// The format as people call it, with its variant: "COLMAP binary".
    pub dialect: &'static str,
    /// The camera file or folder, relative to the scene's root.
    pub source: PathBuf,
    /// Photographs found.
    pub num_images: usize,
    /// Different sets of intrinsics among them.
    pub num_cameras: usize,
}

impl fmt::Display for SceneFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = |count: usize| if count == 1 { "" } else { "s" };
        f.write_str(self.dialect)?;
        if !self.source.as_os_str().is_empty() {
            write!(f, " ({})", self.source.display())?;
        }
        let (images, cameras) = (self.num_images, self.num_cameras);
        write!(f, ", {images} image{}, {cameras} camera{}", plural(images), plural(cameras))
    }
}
