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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rendered::tests::grey;
    use crate::source::tests::with_targets;
    use surfel_core::Grid;

    #[test]
    fn a_tenth_off_is_twenty_decibels_and_equal_pictures_are_perfect() {
        let device = Device::flex();
        let mut sample = with_targets(3, 2);
        let surfels = grey(&sample, &device);
        for (target, offset) in sample.targets.iter_mut().zip([0.0, 0.1]) {
            let maps = render(&surfels, &target.camera, &target.range.render_config()).unwrap();
            let colours: Vec<f32> = maps.colour.permute([1, 2, 0]).into_data().try_into_vec().unwrap();
            let colours = colours.as_chunks::<3>().0.iter().map(|rgb| rgb.map(|c| c + offset)).collect();
            target.image = Grid::from_vec(target.image.width(), target.image.height(), colours);
        }
        let psnr = psnr(&surfels, &sample, &device).unwrap();
        assert!((psnr[0] - 100.0).abs() < 1e-9 && (psnr[1] - 20.0).abs() < 1e-3, "{psnr:?}");
    }
}
