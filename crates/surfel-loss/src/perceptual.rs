//! The perceptual term: LPIPS where its weights are at hand, SSIM where not (paper: `L_LPIPS`; spec 4.3).
//!
//! Invariant: zero for equal pictures, and it says which of the two it is.

use crate::error::{LossError, check_pair};
use crate::lpips::Lpips;
use crate::ssim::{SIDE, ssim};
use burn::tensor::Tensor;

/// How the look of two pictures is compared.
#[derive(Clone, Debug)]
pub enum Perceptual {
    /// By features of VGG16.
    Lpips(Box<Lpips>),
    /// By `1 - SSIM`, which needs no weights.
    Ssim,
}

impl Perceptual {
    /// What to write in a log.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Lpips(_) => "LPIPS",
            Self::Ssim => "1 - SSIM",
        }
    }

    /// Distance of two pictures `[3, height, width]`, sRGB in \[0, 1\].
    ///
    /// # Errors
    /// [`LossError`] for pictures of different sizes, or smaller than the measure looks at.
    pub fn distance(&self, picture: Tensor<3>, photograph: Tensor<3>) -> Result<Tensor<1>, LossError> {
        match self {
            Self::Lpips(lpips) => lpips.distance(picture, photograph),
            Self::Ssim => {
                check_pair("SSIM", SIDE, picture.dims(), photograph.dims())?;
                Ok(-ssim(picture, photograph) + 1.0)
            }
        }
    }
}
