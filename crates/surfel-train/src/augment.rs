//! The mirror: the one augmentation that keeps cameras, matching and truth exact (spec 4.6).
//!
//! A scene seen in a mirror is a scene: every view is flipped left to right and the world with it. Invariant:
//! mirroring twice gives the sample back, and a mirrored sample is one that could have been photographed.

use crate::sample::{Sample, Target};
use crate::truth::ViewTruth;
use surfel_core::{Camera, Grid};
use surfel_net::Seed;

/// The mirrored sample.
pub fn mirrored(sample: &Sample) -> Sample {
    Sample {
        images: sample.images.iter().map(Grid::flipped).collect(),
        cameras: sample.cameras.iter().map(Camera::mirrored).collect(),
        ranges: sample.ranges.clone(),
        seeds: sample.seeds.iter().map(mirrored_seed).collect(),
        truth: sample.truth.iter().map(ViewTruth::mirrored).collect(),
        targets: sample.targets.iter().map(mirrored_target).collect(),
    }
}

fn mirrored_target(target: &Target) -> Target {
    Target {
        image: target.image.flipped(),
        camera: target.camera.mirrored(),
        range: target.range,
        truth: target.truth.mirrored(),
    }
}

fn mirrored_seed(seed: &Seed) -> Seed {
    Seed {
        planes: seed.planes.flipped().map(|[w, w_x, w_y]| [*w, -w_x, *w_y]),
        evidence: seed.evidence.flipped(),
        correlation: seed.correlation.flipped(),
        confidence: seed.confidence.flipped(),
        step: seed.step,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::tests::{analytic, with_targets};
    use glam::DVec2;

    #[test]
    fn twice_is_once() {
        let sample = with_targets(1, 1);
        let twice = mirrored(&mirrored(&sample));
        assert_eq!(twice.truth, sample.truth);
        assert_eq!(
            (&twice.targets[0].image, &twice.targets[0].truth),
            (&sample.targets[0].image, &sample.targets[0].truth)
        );
        assert_ne!(mirrored(&sample).targets[0].image, sample.targets[0].image);
        assert_eq!(twice.seeds[0].planes, sample.seeds[0].planes);
        for (a, b) in twice.cameras.iter().zip(&sample.cameras) {
            assert!((a.intrinsics.cx - b.intrinsics.cx).abs() < 1e-12);
            assert_eq!(a.camera_from_world, b.camera_from_world);
        }
    }

    #[test]
    fn points_land_where_their_mirror_images_do() {
        let sample = analytic(1);
        let mirrored = mirrored(&sample);
        let (x, y, width) = (13, 14, 48);
        let depth_at = |sample: &Sample, x: usize| sample.truth[0].depth_at(y * width + x);
        let depth = f64::from(depth_at(&sample, x));
        assert!(depth > 0.0 && depth_at(&sample, x) == depth_at(&mirrored, width - 1 - x));
        let landed = |sample: &Sample, x: usize| {
            let world = sample.cameras[0].unproject(Camera::pixel_centre(x, y), depth);
            sample.cameras[1].project(world).unwrap()
        };
        let ((a, z), (b, z_mirrored)) = (landed(&sample, x), landed(&mirrored, width - 1 - x));
        assert!((DVec2::new(width as f64 - a.x, a.y) - b).length() < 1e-9 && (z - z_mirrored).abs() < 1e-9);
        assert!((b.x - a.x).abs() > 1e-3, "the test cannot tell left from right");
    }
}
