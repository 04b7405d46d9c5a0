//! Why a reconstruction stopped, as one sentence for the person who asked for it.

use surfel_io::photo::ImageError;
use surfel_io::scene::SceneError;
use surfel_io::write::WriteError;

/// Every way the road can end early. Nothing has been written then.
#[derive(Debug, thiserror::Error)]
pub enum ReconstructError {
    /// The cameras or the choice of views.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A photograph or mask.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A depth range cannot be found.
    #[error("{views}: {source} (in the unit of the camera file)")]
    Range {
        /// The photographs.
        views: String,
        /// What is missing.
        source: surfel_pair::BoundsError,
    },
    /// Something about the choice of views or options.
    #[error("{0}")]
    Choice(String),
    /// The cameras cannot be right.
    #[error("{views}: {sentence}")]
    Cameras {
        /// The two photographs.
        views: String,
        /// The verdict of the sanity check.
        sentence: String,
    },
    /// The pretrained features.
    #[error(transparent)]
    Weights(#[from] surfel_features::WeightsError),
    /// The network.
    #[error(transparent)]
    Network(#[from] surfel_net::InputError),
    /// Rendering.
    #[error(transparent)]
    Raster(#[from] surfel_raster::RasterError),
    /// Meshing.
    #[error(transparent)]
    Mesh(#[from] surfel_mesh::MeshError),
    /// Writing.
    #[error(transparent)]
    Write(#[from] WriteError),
}
