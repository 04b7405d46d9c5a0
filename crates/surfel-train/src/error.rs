//! Why training stops, as sentences.

use std::path::PathBuf;

/// What can go wrong in training.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A file that cannot be read or written.
    #[error("{path} cannot be {verb}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// "read" or "written".
        verb: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file whose content is not what it should be.
    #[error("{path} is damaged ({reason}); delete it and it is made again")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A configuration that is not TOML, or has unknown or missing keys.
    #[error("the training configuration {path} cannot be used: {reason}")]
    Config {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A folder of photographs that is not laid out as its kind is, or is empty.
    #[error("{source}; `folder` of a source of kind {kind} names {expected}")]
    Layout {
        /// The kind of source.
        kind: &'static str,
        /// What its folder should be.
        expected: &'static str,
        /// What is missing.
        source: Box<surfel_data::DataError>,
    },
    /// A set in which no scene can be used as the source asks.
    #[error("{folder}: of {draws} scenes drawn none can be used; the last: {reason}")]
    NoUsableScene {
        /// The folder of the set.
        folder: PathBuf,
        /// Number of scenes tried.
        draws: usize,
        /// What is wrong with the last, and what to do.
        reason: String,
    },
    /// A photograph, camera or chunk that cannot be used.
    #[error(transparent)]
    Data(Box<surfel_data::DataError>),
    /// Samples of which no term of the loss knows the truth.
    #[error(
        "step {step} has nothing to learn from: its samples know nothing that a term of the loss asks for; give weights to terms of [loss.rendered], which photographs alone can tell"
    )]
    NothingToLearn {
        /// Steps done.
        step: u64,
    },
    /// A checkpoint of another run.
    #[error(
        "{path} is a checkpoint of another run ({reason}); give another output folder or the configuration it was made with"
    )]
    OtherRun {
        /// The checkpoint.
        path: PathBuf,
        /// What differs.
        reason: String,
    },
    /// Scans are asked for, and no folder of them is known.
    #[error(
        "the configuration trains on scans; say with --assets where the folder with index.json, meshes/, textures/ and envmaps/ is"
    )]
    NoAssets,
    /// A sample without surface.
    #[error("a training scene shows no surface; its views all look past everything")]
    EmptyScene,
    /// A loss that is not a number.
    #[error("the loss of step {step} is {loss}; lower the learning rate and resume from an earlier checkpoint")]
    Diverged {
        /// The step.
        step: u64,
        /// Its loss.
        loss: f64,
    },
    /// The assets of rendered scenes.
    #[error(transparent)]
    Assets(#[from] surfel_synth::AssetError),
    /// Weights of the trunk or of a checkpoint.
    #[error(transparent)]
    Weights(#[from] surfel_features::WeightsError),
    /// A picture that cannot be written.
    #[error(transparent)]
    Picture(#[from] surfel_io::write::WriteError),
    /// Surfels that cannot be rendered.
    #[error("the predicted surfels cannot be rendered: {0}")]
    Render(#[from] surfel_raster::RasterError),
    /// Views that a term cannot compare.
    #[error(transparent)]
    Loss(#[from] surfel_loss::LossError),
    /// A scene the network refuses.
    #[error(transparent)]
    Input(#[from] surfel_net::InputError),
}

impl From<surfel_data::DataError> for TrainError {
    fn from(error: surfel_data::DataError) -> Self {
        Self::Data(Box::new(error))
    }
}

impl TrainError {
    /// For `map_err` after reading a file.
    pub(crate) fn unreadable(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |source| Self::File { path: path.to_path_buf(), verb: "read", source }
    }

    /// For `map_err` after writing a file.
    pub(crate) fn unwritable(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |source| Self::File { path: path.to_path_buf(), verb: "written", source }
    }
}
