//! The mirror: the one augmentation that keeps cameras, matching and truth exact (spec 4.6).
//!
//! A scene seen in a mirror is a scene: every view is flipped left to right and the world with it. Invariant:
//! mirroring twice gives the sample back, and a mirrored sample is one that could have been photographed.

use crate::sample::Sample;
use surfel_core::{Camera, Grid};
use surfel_net::Seed;

/// The mirrored sample.
pub fn mirrored(sample: &Sample) -> Sample {
    let normal = |n: &[f32; 3]| [-n[0], n[1], n[2]];
    Sample {
        images: sample.images.iter().map(Grid::flipped).collect(),
        cameras: sample.cameras.iter().map(Camera::mirrored).collect(),
        ranges: sample.ranges.clone(),
        seeds: sample.seeds.iter().map(mirrored_seed).collect(),
        depth: sample.depth.iter().map(Grid::flipped).collect(),
        normal: sample.normal.iter().map(|map| map.flipped().map(normal)).collect(),
        object: sample.object.iter().map(Grid::flipped).collect(),
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
    use crate::source::{Source, SourceConfig, SourceKind};
    use glam::DVec2;
    use surfel_synth::Split;

    fn sample() -> Sample {
        let kind = SourceKind::Analytic;
        let (pair_angle_deg, defects, sharpening) = ([6.0, 20.0], 1.0, [0.0, 0.0]);
        let (seed, width, height, num_views, room_share) = (1, 40, 32, 2, 0.0);
        let config =
            SourceConfig { kind, seed, width, height, num_views, room_share, pair_angle_deg, defects, sharpening };
        Source::open(&config, Split::Train, None).unwrap().sample(0).unwrap()
    }

    #[test]
    fn twice_is_once() {
        let sample = sample();
        let twice = mirrored(&mirrored(&sample));
        assert_eq!(twice.depth, sample.depth);
        assert_eq!(twice.normal, sample.normal);
        assert_eq!(twice.seeds[0].planes, sample.seeds[0].planes);
        for (a, b) in twice.cameras.iter().zip(&sample.cameras) {
            assert!((a.intrinsics.cx - b.intrinsics.cx).abs() < 1e-12);
            assert_eq!(a.camera_from_world, b.camera_from_world);
        }
    }

    #[test]
    fn points_land_where_their_mirror_images_do() {
        let sample = sample();
        let mirrored = mirrored(&sample);
        let (x, y, width) = (11, 14, 40);
        let depth = f64::from(sample.depth[0][(x, y)]);
        assert!(depth > 0.0 && sample.depth[0][(x, y)] == mirrored.depth[0][(width - 1 - x, y)]);
        let landed = |sample: &Sample, x: usize| {
            let world = sample.cameras[0].unproject(Camera::pixel_centre(x, y), depth);
            sample.cameras[1].project(world).unwrap()
        };
        let ((a, z), (b, z_mirrored)) = (landed(&sample, x), landed(&mirrored, width - 1 - x));
        assert!((DVec2::new(width as f64 - a.x, a.y) - b).length() < 1e-9 && (z - z_mirrored).abs() < 1e-9);
        assert!((b.x - a.x).abs() > 1e-3, "the test cannot tell left from right");
    }
}
