//! Cameras that stand where they are said to stand and look a little elsewhere, as real calibrations have it.
//!
//! Every camera but the first is turned about the line from the first to it. That moves all it sees across the epipolar
//! lines and nothing along them, so the photographs still tell every depth; a turn about another axis would move all
//! depths together, and of that a network can learn nothing but doubt. Invariant: centres and intrinsics stay.

use glam::DMat3;
use surfel_core::Camera;
use surfel_synth::Random;

/// The stream of chance that turns are drawn from; no other part of a scene draws from it.
const STREAM: u64 = u64::MAX - 2;

/// Turns all `cameras` but the first so that a point in the middle of a photograph moves by some pixels across its
/// epipolar line: normally distributed, with a standard deviation that is uniform up to `most_px` from scene to scene.
pub(super) fn turn<'a>(cameras: impl IntoIterator<Item = &'a mut Camera>, most_px: f64, seed: u64) {
    if most_px == 0.0 {
        // Not even by the rounding of a turn by nothing.
        return;
    }
    let mut random = Random::fork(seed, STREAM);
    let deviation = random.range(0.0, most_px);
    let mut cameras = cameras.into_iter();
    let Some(first) = cameras.next() else { return };
    for camera in cameras {
        let shift = deviation * random.normal();
        let Some(axis) = (camera.centre() - first.centre()).try_normalize() else { continue };
        let angle = shift / camera.intrinsics.mean_focal();
        *camera = camera.turned(DMat3::from_axis_angle(axis, -angle));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use surfel_core::{Intrinsics, Rigid};

    fn camera(centre: DVec3, yaw: f64) -> Camera {
        let rotation = DMat3::from_quat(DQuat::from_rotation_y(yaw));
        Camera {
            intrinsics: Intrinsics { fx: 300.0, fy: 300.0, cx: 160.0, cy: 128.0 },
            width: 320,
            height: 256,
            camera_from_world: Rigid { rotation, translation: -(rotation * centre) },
        }
    }

    #[test]
    fn points_move_across_their_epipolar_lines_and_not_along_them() {
        let first = camera(DVec3::ZERO, 0.0);
        for centre in [DVec3::new(0.5, 0.1, 0.0), DVec3::new(0.1, 0.0, 0.6)] {
            let mut largest: f64 = 0.0;
            for seed in 0..20 {
                let (mut fixed, mut turned) = (first, camera(centre, 0.05));
                let before = turned;
                turn([&mut fixed, &mut turned], 0.8, seed);
                assert_eq!(fixed, first);
                assert!(turned.centre().distance(centre) < 1e-12 && turned.intrinsics == before.intrinsics);
                for ray in [DVec3::new(0.1, 0.05, 1.0), DVec3::new(-0.2, -0.3, 1.0)] {
                    // The epipolar line of a point joins where its ray is nearer and where it is farther.
                    let [near, at, far] = [2.9, 3.0, 3.1].map(|z| before.project(ray * z).unwrap().0);
                    let line = (far - near).normalize();
                    let moved = turned.project(ray * 3.0).unwrap().0 - at;
                    assert!(moved.dot(line).abs() < 0.1 * moved.length() + 1e-9, "{moved} along {line}");
                    largest = largest.max(moved.length());
                }
            }
            assert!((0.05..3.5).contains(&largest), "{largest}");
        }
    }

    #[test]
    fn cameras_that_are_right_stay_to_the_last_bit() {
        let (mut first, mut second) = (camera(DVec3::ZERO, 0.0), camera(DVec3::new(0.3, 0.1, 0.2), 0.7));
        let before = (first, second);
        turn([&mut first, &mut second], 0.0, 5);
        assert_eq!((first, second), before);
    }
}
