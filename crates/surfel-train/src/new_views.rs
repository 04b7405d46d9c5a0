//! How much a prediction looks like its scene from places the network was not shown (spec 7.4).
//!
//! Part of a validation, and all of it where no depth is known. Invariant: a number per view held out, none left out.

use crate::error::TrainError;
use crate::sample::{Sample, Target};
use surfel_core::Grid;
use surfel_net::{SurfelTensors, render, values};

/// What a perfect picture counts, decibels; a mean with infinity in it would say nothing.
const PERFECT: f64 = 100.0;

/// PSNR in decibels of every view held out, colours in \[0, 1\]; a perfect picture counts as 100.
///
/// # Errors
/// When the surfels cannot be rendered.
pub(crate) fn psnr(surfels: &SurfelTensors, sample: &Sample) -> Result<Vec<f64>, TrainError> {
    let of_target = |target: &Target| {
        let maps = render(surfels, &target.camera, &target.range.render_config())?;
        let colours = values(maps.colour.permute([1, 2, 0])).as_chunks::<3>().0.to_vec();
        let picture = Grid::from_vec(target.image.width(), target.image.height(), colours);
        Ok(surfel_eval::psnr::psnr(&picture, &target.image).min(PERFECT))
    };
    sample.targets.iter().map(of_target).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rendered::tests::grey;
    use crate::source::tests::with_targets;
    use burn::tensor::Device;

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
        let psnr = psnr(&surfels, &sample).unwrap();
        assert!((psnr[0] - 100.0).abs() < 1e-9 && (psnr[1] - 20.0).abs() < 1e-3, "{psnr:?}");
    }
}
