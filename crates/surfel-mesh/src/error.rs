//! Why a mesh could not be made.

/// Errors of [`crate::fuse`] and [`crate::mesh_from_views`]; views are counted from 0.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// The list of views is empty.
    #[error("there is no view to fuse; give at least one depth map with its camera")]
    NoViews,
    /// A grid and the camera disagree.
    #[error(
        "view {view}: the {map} is {width}x{height} but the camera is {camera_width}x{camera_height}; \
         resize them together"
    )]
    SizeMismatch {
        /// Index of the view.
        view: usize,
        /// Which map: "depth", "colour" or "weight".
        map: &'static str,
        /// Columns of the map.
        width: usize,
        /// Rows of the map.
        height: usize,
        /// Columns of the camera.
        camera_width: usize,
        /// Rows of the camera.
        camera_height: usize,
    },
    /// A focal length or pose is not a usable number.
    #[error("view {view}: the camera has a focal length that is not positive or a pose that is not finite")]
    BadCamera {
        /// Index of the view.
        view: usize,
    },
    /// No pixel of any view carries depth.
    #[error(
        "no pixel of the {num_views} view(s) has a depth that is finite and positive after masking; nothing to mesh"
    )]
    NoDepth {
        /// Number of views looked at.
        num_views: usize,
    },
    /// The voxel edge, truncation or uniform radius is unusable.
    #[error("{name} is {value}; it must be a positive number, in scene units")]
    BadLength {
        /// Which setting.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// The volume would not fit the memory limit.
    #[error(
        "the volume needs at least {needed_mib} MiB of voxels and the limit is {limit_mib} MiB; the voxel edge \
         {voxel} is small for these depth maps: choose a larger voxel, or raise the limit"
    )]
    TooManyBlocks {
        /// Lower bound of what is needed, MiB.
        needed_mib: usize,
        /// The configured limit, MiB.
        limit_mib: usize,
        /// Voxel edge, scene units.
        voxel: f64,
    },
}
