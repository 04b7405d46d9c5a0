//! How good a network is on samples it never learned from, beside matching on the same samples.
//!
//! Invariant: the same pixels count for both, all whose true depth is known; none is left out for being hard, and what
//! cannot be measured is not stated.

use crate::error::TrainError;
use crate::new_views;
use crate::sample::Sample;
use serde::{Deserialize, Serialize};
use surfel_core::Camera;
use surfel_core::normals::{normal_from_gradient, normal_from_rotation};
use surfel_eval::Calibration;
use surfel_net::{SurfelNet, values};

/// Scores over the pixels of some samples, all or those of objects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// Share of pixels within 1 % of the true depth.
    pub within_1pct: f64,
    /// Median relative depth error, per cent.
    pub median_pct: f64,
    /// Mean angle to the true normal, degrees; `None` where no normal is known.
    pub normal_deg: Option<f64>,
    /// Root mean square difference between confidence and being within 1 %, over ten equal bins of confidence.
    pub calibration: f64,
}

/// Scores of matching and of the network; `None` where no pixel of the samples has a known depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Matching, all pixels.
    pub matching: Option<Scores>,
    /// The network, all pixels.
    pub network: Option<Scores>,
    /// Matching, objects only.
    pub matching_objects: Option<Scores>,
    /// The network, objects only.
    pub network_objects: Option<Scores>,
    /// Mean PSNR of views held out, decibels; `None` where the samples hold none out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub new_views_psnr: Option<f64>,
}

impl Validation {
    /// What the best weights are best at: pixels within 1 % of the depth, or new views where no depth is known.
    pub fn score(&self) -> Option<f64> {
        self.network.map(|scores| scores.within_1pct).or(self.new_views_psnr)
    }
}

/// Relative depth error up to which a pixel counts as right.
const RIGHT: f32 = 0.01;

/// Errors of pixels, gathered over samples.
#[derive(Default)]
struct Tally {
    relative: Vec<f32>,
    angles: f64,
    num_angles: usize,
    calibration: Calibration,
}

impl Tally {
    fn add(&mut self, relative: f32, confidence: f32) {
        self.calibration.add(confidence, relative <= RIGHT);
        self.relative.push(relative);
    }

    fn add_angle(&mut self, predicted: [f32; 3], truth: [f32; 3]) {
        let dot: f32 = predicted.iter().zip(truth).map(|(a, b)| a * b).sum();
        self.angles += f64::from(dot.clamp(-1.0, 1.0).acos().to_degrees());
        self.num_angles += 1;
    }

    fn scores(mut self) -> Option<Scores> {
        let count = self.relative.len();
        if count == 0 {
            return None;
        }
        let right = self.relative.iter().filter(|error| **error <= RIGHT).count();
        let median = *self.relative.select_nth_unstable_by(count / 2, f32::total_cmp).1;
        Some(Scores {
            within_1pct: right as f64 / count as f64,
            median_pct: 100.0 * f64::from(median),
            normal_deg: (self.num_angles > 0).then(|| self.angles / self.num_angles as f64),
            calibration: self.calibration.error()?,
        })
    }
}

/// Scores `net` and matching on samples.
///
/// # Errors
/// When a sample cannot be made or is refused.
pub fn validate(
    net: &SurfelNet,
    samples: impl Iterator<Item = Result<Sample, TrainError>>,
) -> Result<Validation, TrainError> {
    let mut tallies: [Tally; 4] = Default::default();
    let mut psnrs = Vec::new();
    for sample in samples {
        let sample = sample?;
        let prediction = net.forward(&sample.input(net.config()), &net.device())?;
        psnrs.extend(new_views::psnr(&prediction.surfels, &sample)?);
        let depth = values(prediction.maps.depth);
        let confidence = values(prediction.maps.confidence);
        let rotations = prediction.surfels.to_surfels().rotations;
        let pixels = sample.num_pixels();
        for v in 0..sample.num_views() {
            let (camera, known) = (&sample.cameras[v], &sample.truth[v]);
            for i in 0..pixels {
                let truth = known.depth_at(i);
                if truth <= 0.0 {
                    continue;
                }
                let seed = &sample.seeds[v];
                let plane = seed.planes.as_slice()[i];
                let error = |z: f32| ((z - truth) / truth).abs();
                let k = v * pixels + i;
                let pixel = (i % camera.width, i / camera.width);
                let matched =
                    (error(1.0 / plane[0]), seed.confidence.as_slice()[i], plane_normal(camera, pixel, plane));
                let learned =
                    (error(depth[k]), confidence[k], normal_from_rotation(camera, pixel.0, pixel.1, rotations[k]));
                let normal = known.normal_at(i);
                for (method, (relative, confidence, predicted)) in [matched, learned].into_iter().enumerate() {
                    let groups = if known.is_object(i) { 0..2 } else { 0..1 };
                    for group in groups {
                        let tally = &mut tallies[2 * group + method];
                        tally.add(relative, confidence);
                        if let Some(normal) = normal {
                            tally.add_angle(predicted, normal);
                        }
                    }
                }
            }
        }
    }
    let [matching, network, matching_objects, network_objects] = tallies.map(Tally::scores);
    let new_views_psnr = (!psnrs.is_empty()).then(|| psnrs.iter().sum::<f64>() / psnrs.len() as f64);
    Ok(Validation { matching, network, matching_objects, network_objects, new_views_psnr })
}

fn plane_normal(camera: &Camera, (x, y): (usize, usize), [w, w_x, w_y]: [f32; 3]) -> [f32; 3] {
    let z = 1.0 / f64::from(w);
    normal_from_gradient(&camera.intrinsics, x as f64, y as f64, z, -f64::from(w_x) * z * z, -f64::from(w_y) * z * z)
}
