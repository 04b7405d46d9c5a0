//! How much a prediction looks like its scene from places the network was not shown (spec 7.4).
//!
//! Part of a validation, and all of it where no depth is known. Invariant: a number per view held out, none left out.

use crate::error::TrainError;
use crate::sample::{Sample, Target};
use burn::tensor::{Device, Tensor, TensorData};
use surfel_net::{SurfelTensors, render};

/// PSNR in decibels of every view held out, colours in \[0, 1\]; a perfect picture counts as 100.
///
/// # Errors
/// When the surfels cannot be rendered.
pub(crate) fn psnr(surfels: &SurfelTensors, sample: &Sample, device: &Device) -> Result<Vec<f64>, TrainError> {
    let of_target = |target: &Target| {
        let maps = render(surfels, &target.camera, &target.range.render_config())?;
        let (width, height) = (target.image.width(), target.image.height());
        let colours = target.image.as_slice().as_flattened().to_vec();
        let photograph = Tensor::<3>::from_data(TensorData::new(colours, [height, width, 3]), device);
        let error = maps.colour.clamp(0.0, 1.0).permute([1, 2, 0]) - photograph;
        let squared = f64::from(error.square().mean().into_scalar::<f32>());
        Ok(-10.0 * squared.max(1e-10).log10())
    };
    sample.targets.iter().map(of_target).collect()
}
