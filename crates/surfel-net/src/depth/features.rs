//! The features that surfels are decoded from (the paper's `F`), put together only when someone decodes them.
//!
//! Beside the depth that the same layers give. At full resolution they are the largest maps of the network, and neither
//! a pass before the last nor a network asked for depth alone reads them. Invariant: what is put together does not
//! depend on when.

use crate::layers::upsample;
use burn::tensor::Tensor;

/// The parts of `F`.
#[derive(Clone, Debug)]
pub(crate) struct Features {
    /// What the refinement says, `[views, channels, height / stride, width / stride]`.
    pub(super) refined: Tensor<4>,
    /// The photographs, `[views, 3, height, width]`.
    pub(super) images: Tensor<4>,
    /// What the backbone says, as `refined`.
    pub(super) upsampled: Tensor<4>,
    /// Pixels of a block, along each axis.
    pub(super) stride: usize,
}

impl Features {
    /// `F`, `[views, feature channels, height, width]`, without the geometry a seeded network adds.
    pub(crate) fn at_every_pixel(self) -> Tensor<4> {
        let Self { refined, images, upsampled, stride } = self;
        Tensor::cat(vec![upsample(refined, stride, 0), images, upsample(upsampled, stride, 0)], 1)
    }
}
