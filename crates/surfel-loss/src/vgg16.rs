//! The convolutions of VGG16 up to `relu5_3`, with frozen weights from a file (spec 7.4).
//!
//! Tensor names are torchvision's, `features.N.weight` and `.bias`. Invariant: weights are constants, so gradients
//! flow to the picture and nowhere else.

use burn::tensor::activation::relu;
use burn::tensor::module::{conv2d, max_pool2d};
use burn::tensor::ops::{ConvOptions, MaxPoolOptions};
use burn::tensor::{Device, Tensor, TensorData};
use surfel_features::WeightsError;
use surfel_features::weights::TensorFile;

/// Channels of the five stages.
pub(crate) const CHANNELS: [usize; 5] = [64, 128, 256, 512, 512];
/// Position of each convolution in torchvision's list of layers, stage by stage.
const LAYERS: [&[usize]; 5] = [&[0, 2], &[5, 7], &[10, 12, 14], &[17, 19, 21], &[24, 26, 28]];
/// Four poolings: a smaller side would vanish.
pub(crate) const MIN_SIDE: usize = 16;

/// The network, stage by stage.
#[derive(Clone, Debug)]
pub(crate) struct Vgg16 {
    stages: Vec<Vec<Convolution>>,
}

#[derive(Clone, Debug)]
struct Convolution {
    weight: Tensor<4>,
    bias: Tensor<1>,
}

impl Vgg16 {
    /// # Errors
    /// [`WeightsError`] for a tensor that is missing or of another shape.
    pub(crate) fn load(file: &TensorFile, device: &Device) -> Result<Self, WeightsError> {
        let mut inputs = 3;
        let mut convolution = |layer: usize, outputs: usize| {
            let shape = [outputs, inputs, 3, 3];
            inputs = outputs;
            let weight = file.values(&format!("features.{layer}.weight"), &shape)?;
            let bias = file.values(&format!("features.{layer}.bias"), &[outputs])?;
            Ok(Convolution {
                weight: Tensor::from_data(TensorData::new(weight, shape), device),
                bias: Tensor::from_data(TensorData::new(bias, [outputs]), device),
            })
        };
        let mut stage = |(layers, outputs): (&&[usize], usize)| {
            layers.iter().map(|&layer| convolution(layer, outputs)).collect::<Result<Vec<_>, _>>()
        };
        let stages = LAYERS.iter().zip(CHANNELS).map(&mut stage).collect::<Result<Vec<_>, _>>()?;
        Ok(Self { stages })
    }

    /// Features `relu1_2`, `relu2_2`, `relu3_3`, `relu4_3` and `relu5_3` of normalised images `[n, 3, height, width]`.
    pub(crate) fn features(&self, images: Tensor<4>) -> Vec<Tensor<4>> {
        let mut outputs: Vec<Tensor<4>> = Vec::with_capacity(self.stages.len());
        for stage in &self.stages {
            let input = match outputs.last() {
                Some(last) => max_pool2d(last.clone(), MaxPoolOptions::new([2, 2])),
                None => images.clone(),
            };
            outputs.push(stage.iter().fold(input, |map, convolution| {
                let options = ConvOptions::new([1, 1], [1, 1], [1, 1], 1);
                relu(conv2d(map, convolution.weight.clone(), Some(convolution.bias.clone()), options))
            }));
        }
        outputs
    }
}
