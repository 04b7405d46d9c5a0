//! LPIPS v0.1 with VGG16: how different two pictures look (spec 7.4).
//!
//! Features of five stages, normalised along the channels, squared differences weighted per channel, mean over
//! pixels, sum over stages. A loss ([`Lpips::distance`]) and a metric ([`Lpips::of_pictures`]) in one; the weights
//! are the user's (`docs/lpips.md`). Invariant: zero exactly for equal pictures, and gradients are always finite.

use crate::error::{LossError, check_pair};
use crate::vgg16::{CHANNELS, MIN_SIDE, Vgg16};
use burn::tensor::{Device, Tensor, TensorData};
use std::path::Path;
use surfel_core::Grid;
use surfel_features::WeightsError;
use surfel_features::weights::{TensorFile, read_file};

/// Maps pictures in \[-1, 1\] to what VGG16 was trained on, as LPIPS does.
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];
/// Square of the 1e-10 that LPIPS adds to the length of a feature; inside the root it keeps gradients finite.
const TINY: f64 = 1e-20;

/// The measure, with weights from a file.
#[derive(Clone, Debug)]
pub struct Lpips {
    vgg: Vgg16,
    /// Weight of each channel of each stage, `[1, channels, 1, 1]`.
    heads: Vec<Tensor<4>>,
    shift: Tensor<4>,
    scale: Tensor<4>,
    device: Device,
}

impl Lpips {
    /// Reads the weights. A device without autodiff will do: gradients flow through constants all the same.
    ///
    /// # Errors
    /// [`WeightsError`] when the file cannot be read, is damaged, or holds another network.
    pub fn from_file(path: impl AsRef<Path>, device: &Device) -> Result<Self, WeightsError> {
        let path = path.as_ref();
        Self::from_bytes(path.display().to_string(), &read_file(path)?, device)
    }

    /// The same from the bytes of a safetensors file; `name` is how messages call it.
    ///
    /// # Errors
    /// As [`Self::from_file`].
    pub fn from_bytes(name: impl Into<String>, bytes: &[u8], device: &Device) -> Result<Self, WeightsError> {
        let file = TensorFile::parse(name, bytes)?;
        let head = |(stage, channels): (usize, usize)| {
            let shape = [1, channels, 1, 1];
            let values = file.values(&format!("lin{stage}.weight"), &shape)?;
            Ok(Tensor::from_data(TensorData::new(values, shape), device))
        };
        let per_channel = |values: [f32; 3]| Tensor::from_data(TensorData::new(values.to_vec(), [1, 3, 1, 1]), device);
        Ok(Self {
            vgg: Vgg16::load(&file, device)?,
            heads: CHANNELS.into_iter().enumerate().map(head).collect::<Result<_, _>>()?,
            shift: per_channel(SHIFT),
            scale: per_channel(SCALE),
            device: device.clone(),
        })
    }

    /// Distance of two pictures `[3, height, width]`, sRGB in \[0, 1\]: 0 for equal ones, about 1 for unrelated ones.
    ///
    /// # Errors
    /// [`LossError`] for pictures of different sizes or with a side below 16 pixels.
    pub fn distance(&self, picture: Tensor<3>, photograph: Tensor<3>) -> Result<Tensor<1>, LossError> {
        check_pair("LPIPS", MIN_SIDE, picture.dims(), photograph.dims())?;
        let stages = self.unit_features(picture).into_iter().zip(self.unit_features(photograph));
        let distance = stages
            .zip(&self.heads)
            .map(|((a, b), head)| ((a - b).square() * head.clone()).sum_dim(1).mean())
            .reduce(|sum, stage| sum + stage);
        Ok(distance.expect("VGG16 has five stages"))
    }

    /// Distance of two pictures, clipped to \[0, 1\] first.
    ///
    /// # Errors
    /// As [`Self::distance`].
    pub fn of_pictures(&self, picture: &Grid<[f32; 3]>, photograph: &Grid<[f32; 3]>) -> Result<f64, LossError> {
        let tensor = |picture: &Grid<[f32; 3]>| {
            let values: Vec<f32> = picture.as_slice().iter().flatten().map(|c| c.clamp(0.0, 1.0)).collect();
            let data = TensorData::new(values, [picture.height(), picture.width(), 3]);
            Tensor::<3>::from_data(data, &self.device).permute([2, 0, 1])
        };
        Ok(f64::from(self.distance(tensor(picture), tensor(photograph))?.into_scalar::<f32>()))
    }

    /// Features of each stage with unit length along the channels.
    fn unit_features(&self, picture: Tensor<3>) -> Vec<Tensor<4>> {
        let image: Tensor<4> = picture.unsqueeze_dim(0) * 2.0 - 1.0;
        let features = self.vgg.features((image - self.shift.clone()) / self.scale.clone());
        let unit = |map: Tensor<4>| {
            let length = (map.clone().square().sum_dim(1) + TINY).sqrt();
            map / length
        };
        features.into_iter().map(unit).collect()
    }
}
