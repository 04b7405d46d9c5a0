//! Trained layers on top of the frozen pretrained trunk: three strides merged into one map at stride 4.
//!
//! Invariant: pixel `i` of the merged map stands over input pixel `4 i`, as in the CNN backbone. The trunk's
//! own centres lie at `4 i + 3`; it is therefore run on images moved by three pixels.

use crate::layers::{Conv2d, conv1x1, conv3x3, upsample};
use crate::ops::{count, gelu};
use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use surfel_core::Grid;
use surfel_features::{FeatureExtractor, FeatureMap, Stage};

const STAGES: [Stage; 3] = [Stage::S4, Stage::S8, Stage::S16];
/// How far the trunk's centre at stride 4 lies from input pixel `4 i`.
const SHIFT: usize = 3;

/// Merges the trunk's stages.
#[derive(Module, Debug)]
pub(crate) struct Pyramid {
    laterals: Vec<Conv2d>,
    merge: Conv2d,
}

impl Pyramid {
    pub(crate) fn new(channels: usize, device: &Device) -> Self {
        Self {
            laterals: STAGES.iter().map(|stage| conv1x1(stage.channels(), channels, device)).collect(),
            merge: conv3x3(channels, channels, device),
        }
    }

    /// Features `[views, channels, height / 4, width / 4]` of images whose sides are multiples of 16.
    pub(crate) fn forward(&self, trunk: &FeatureExtractor, images: &[Grid<[f32; 3]>], device: &Device) -> Tensor<4> {
        let maps: Vec<Vec<FeatureMap>> = images.iter().map(|image| trunk.extract(&moved(image), &STAGES)).collect();
        let (width, height) = (images[0].width(), images[0].height());
        count::tell(images.len() as u64 * trunk.multiply_adds((width + SHIFT, height + SHIFT), &STAGES));
        self.merged(std::array::from_fn(|i| {
            let stride = STAGES[i].stride();
            let stage = maps.iter().map(|maps| to_tensor(&maps[i], width / stride, height / stride, device)).collect();
            Tensor::cat(stage, 0)
        }))
    }

    /// One map of the trunk's maps of moved images, each `[views, channels, height / stride, width / stride]`.
    pub(crate) fn merged(&self, stages: [Tensor<4>; 3]) -> Tensor<4> {
        let maps = stages.into_iter().zip(STAGES).zip(&self.laterals).map(|((map, stage), lateral)| {
            // Centres at stride s lie at `s i + s - 4` after the move: `s / 4 - 1` coarse pixels late.
            let factor = stage.stride() / 4;
            upsample(lateral.forward(map), factor, factor - 1)
        });
        self.merge.forward(gelu(maps.reduce(|sum, map| sum + map).expect("the trunk has stages")))
    }
}

/// The image moved right and down by [`SHIFT`] pixels over its repeated border.
fn moved(image: &Grid<[f32; 3]>) -> Grid<[f32; 3]> {
    Grid::from_fn(image.width() + SHIFT, image.height() + SHIFT, |x, y| {
        image[(x.saturating_sub(SHIFT), y.saturating_sub(SHIFT))]
    })
}

/// The top-left `width` x `height` pixels as `[1, channels, height, width]`.
fn to_tensor(map: &FeatureMap, width: usize, height: usize, device: &Device) -> Tensor<4> {
    let map = map.cropped(width, height);
    let data = TensorData::new(map.data, [1, height, width, map.channels]);
    Tensor::<4>::from_data(data, device).permute([0, 3, 1, 2])
}
