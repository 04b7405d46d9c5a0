//! Pretrained image features: the EfficientNet-Lite0 trunk, on plain slices.
//!
//! First stage of matching and of the network (`FeatureExtractor`); weights ship with the crate.
//! Invariant: feature pixel `i` of a stage with stride `s` is centred on *continuous* input coordinate
//! `s i + s - 0.5` (index coordinate `s i + s - 1`) in both axes, at every image size. That is not the
//! middle `s i + s / 2` of its cell: each stride-2 layer pads only right and bottom ("same" padding as
//! the weights were trained with), which shifts the centre by `(s - 1) / 2` pixels towards the right and bottom.

mod block;
mod depthwise;
mod pointwise;
mod stem;
mod trunk;
pub mod weights;

pub use weights::WeightsError;

use crate::weights::{TensorFile, read_file};
use std::path::Path;
use surfel_core::Grid;
use trunk::Trunk;

const SHIPPED: &[u8] = include_bytes!("../weights/efficientnet_lite0_trunk_s16_f16.safetensors");

/// The resolutions at which the trunk can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// Stride 4, 24 channels: the finest, what matching uses.
    S4,
    /// Stride 8, 40 channels.
    S8,
    /// Stride 16, 112 channels: context, too coarse to match on.
    S16,
}

impl Stage {
    /// Input pixels per feature pixel.
    pub const fn stride(self) -> usize {
        match self {
            Self::S4 => 4,
            Self::S8 => 8,
            Self::S16 => 16,
        }
    }

    /// Feature channels.
    pub const fn channels(self) -> usize {
        match self {
            Self::S4 => 24,
            Self::S8 => 40,
            Self::S16 => 112,
        }
    }
}

/// A map of feature vectors.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatureMap {
    /// Values per pixel.
    pub channels: usize,
    /// Columns: `ceil(image width / stride)`.
    pub width: usize,
    /// Rows: `ceil(image height / stride)`.
    pub height: usize,
    /// Input pixels per feature pixel.
    pub stride: usize,
    /// Pixel-major: channel `c` of pixel `(x, y)` at `data[(y * width + x) * channels + c]`.
    pub data: Vec<f32>,
}

impl FeatureMap {
    /// The feature vector of pixel `(x, y)`.
    pub fn pixel(&self, x: usize, y: usize) -> &[f32] {
        &self.data[(y * self.width + x) * self.channels..][..self.channels]
    }

    /// Continuous input coordinate (first pixel centre at 0.5) of the centre of feature column or row `i`.
    pub fn centre_in_input(&self, i: usize) -> f64 {
        (self.stride * (i + 1)) as f64 - 0.5
    }

    /// Where a continuous input coordinate falls in feature *index* coordinates (pixel `i` at `i`);
    /// the inverse of [`Self::centre_in_input`].
    pub fn index_from_input(&self, continuous: f64) -> f64 {
        (continuous + 0.5) / self.stride as f64 - 1.0
    }

    /// The top-left `width` x `height` pixels.
    ///
    /// # Panics
    /// If the map is smaller.
    pub fn cropped(&self, width: usize, height: usize) -> Self {
        let row = self.width * self.channels;
        let data = (0..height).flat_map(|y| &self.data[y * row..][..width * self.channels]).copied().collect();
        Self { channels: self.channels, width, height, stride: self.stride, data }
    }
}

/// The pretrained trunk, ready to run.
#[derive(Clone, Debug)]
pub struct FeatureExtractor {
    trunk: Trunk,
}

impl FeatureExtractor {
    /// With the weights that ship with the crate.
    ///
    /// # Errors
    /// [`WeightsError`] if the crate was built with a damaged file.
    pub fn new() -> Result<Self, WeightsError> {
        Self::parse("the built-in EfficientNet-Lite0 weights", SHIPPED)
    }

    /// With weights of the same network from a safetensors file (f16 or f32).
    ///
    /// # Errors
    /// [`WeightsError`] when the file cannot be read, is damaged, or belongs to another network.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, WeightsError> {
        let path = path.as_ref();
        Self::parse(&path.display().to_string(), &read_file(path)?)
    }

    fn parse(name: &str, bytes: &[u8]) -> Result<Self, WeightsError> {
        Ok(Self { trunk: Trunk::load(&TensorFile::parse(name, bytes)?)? })
    }

    /// Multiplications with addition that [`Self::extract`] takes for an image of this width and height.
    pub fn multiply_adds(&self, (width, height): (usize, usize), stages: &[Stage]) -> u64 {
        self.trunk.multiply_adds(width, height, stages)
    }

    /// The feature maps of an sRGB image in \[0, 1\], one per entry of `stages` and in that order.
    ///
    /// Any size: the image is padded to a multiple of 16 by repeating its last column and row, so a
    /// stage's values do not depend on which others are asked for. Only the layers needed are run.
    /// An image without pixels yields maps without pixels.
    pub fn extract(&self, image: &Grid<[f32; 3]>, stages: &[Stage]) -> Vec<FeatureMap> {
        let maps = self.trunk.run(image, stages);
        let size = |n: usize, stage: Stage| n.div_ceil(stage.stride());
        let find = |stage: Stage| maps.iter().find(|(s, _)| *s == stage);
        stages
            .iter()
            .filter_map(|&stage| find(stage))
            .map(|(stage, map)| map.cropped(size(image.width(), *stage), size(image.height(), *stage)))
            .collect()
    }
}
