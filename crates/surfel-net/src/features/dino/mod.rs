//! Frozen DINOv2 features of photographs, from weights that the user brings (spec 1.10, row 3; paper: appendix).
//!
//! `vit` is the transformer, `load` reads published files into it, `fusion` adds its features to the backbone's.
//! Invariant: nothing here is trained or written into weights files but the fusion.

mod fusion;
mod load;
mod resample;
mod vit;

pub(crate) use fusion::DinoFusion;
pub(crate) use vit::Vit;

use burn::tensor::{Device, Tensor};
use resample::{linear, resampled};
use serde::{Deserialize, Serialize};
use std::path::Path;
use surfel_features::WeightsError;

/// ImageNet statistics of sRGB in \[0, 1\].
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const STD: [f32; 3] = [0.229, 0.224, 0.225];
/// Sides of a patch, pixels.
const PATCH: usize = 14;

/// The published models without register tokens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DinoModel {
    /// ViT-S/14, 22 M parameters.
    VitS14,
    /// ViT-B/14, 87 M parameters.
    VitB14,
    /// ViT-L/14, 304 M parameters, 1.2 GB in f32.
    VitL14,
    /// For tests.
    Tiny,
}

/// Sizes of a model.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sizes {
    /// Channels of a token.
    pub(crate) width: usize,
    pub(crate) depth: usize,
    pub(crate) num_heads: usize,
    /// Patches per side of the images it was trained on.
    pub(crate) grid: usize,
}

impl DinoModel {
    /// Channels of its features.
    pub fn width(self) -> usize {
        self.sizes().width
    }

    pub(crate) fn sizes(self) -> Sizes {
        let (width, depth, num_heads, grid) = match self {
            Self::VitS14 => (384, 12, 6, 37),
            Self::VitB14 => (768, 12, 12, 37),
            Self::VitL14 => (1024, 24, 16, 37),
            Self::Tiny => (16, 2, 2, 3),
        };
        Sizes { width, depth, num_heads, grid }
    }
}

impl std::fmt::Display for DinoModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::VitS14 => "DINOv2 ViT-S/14",
            Self::VitB14 => "DINOv2 ViT-B/14",
            Self::VitL14 => "DINOv2 ViT-L/14",
            Self::Tiny => "the tiny DINOv2 of tests",
        })
    }
}

/// A model with its weights.
#[derive(Clone, Debug)]
pub(crate) struct Dino {
    vit: Vit,
    device: Device,
}

impl Dino {
    /// # Errors
    /// [`WeightsError`] when the file cannot be read, is damaged, or holds another model.
    pub(crate) fn from_file(model: DinoModel, path: &Path, device: &Device) -> Result<Self, WeightsError> {
        // On a device that records no gradients.
        let device = device.clone().inner();
        Ok(Self { vit: load::load(model, path, &device)?, device })
    }

    /// Where it runs, and where its images must be.
    pub(crate) fn device(&self) -> &Device {
        &self.device
    }

    /// Features of patches `[views, width, rows, columns]` of sRGB images `[views, 3, height, width]` in \[0, 1\],
    /// which are resized to whole patches: patch `i` of `n` covers the share `i / n` to `(i + 1) / n` of a side.
    pub(crate) fn patches(&self, images: Tensor<4>) -> Tensor<4> {
        let [views, _, height, width] = images.dims();
        // Upwards, so that no detail is lost.
        let (rows, columns) = (height.div_ceil(PATCH), width.div_ceil(PATCH));
        let resized = |inputs: usize, outputs: usize| {
            let position = move |i: usize| (i as f64 + 0.5) * inputs as f64 / outputs as f64 - 0.5;
            linear((0..outputs).map(position), inputs)
        };
        let images = resampled(images, &resized(height, rows * PATCH), &resized(width, columns * PATCH));
        let statistic = |values: [f32; 3]| Tensor::<1>::from_floats(values, &self.device).reshape([1, 3, 1, 1]);
        let images = (images - statistic(MEAN)) / statistic(STD);
        // One view at a time: attention is quadratic in the patches of what it is given.
        Tensor::cat((0..views).map(|view| self.vit.forward(images.clone().narrow(0, view, 1))).collect(), 0)
    }
}
