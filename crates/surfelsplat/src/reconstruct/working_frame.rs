//! The frame in which the road is computed, and the way back to the scene.
//!
//! Axes and origin of the first camera, unit = the longest baseline. Invariant: the photographs do not
//! change, so nothing downstream can depend on the scene's unit, origin or orientation.

use glam::DMat3;
use surfel_core::{Camera, Similarity};

/// `working_from_scene` for the chosen cameras; `None` when all of them stand in one place.
pub fn working_from_scene(cameras: &[Camera]) -> Option<Similarity> {
    let first = cameras.first()?;
    let baseline = longest_baseline(cameras);
    let reach = cameras.iter().map(|c| c.centre().length()).fold(0.0, f64::max);
    // Below this the baseline is rounding error of the camera centres.
    if baseline.is_nan() || baseline <= 1e-9 * reach {
        return None;
    }
    let scale = 1.0 / baseline;
    let rotation: DMat3 = first.camera_from_world.rotation;
    Some(Similarity { scale, rotation, translation: rotation * -first.centre() * scale })
}

/// Largest distance between two camera centres, scene units.
pub fn longest_baseline(cameras: &[Camera]) -> f64 {
    let pairs = cameras.iter().enumerate().flat_map(|(i, a)| cameras[..i].iter().map(move |b| (a, b)));
    pairs.map(|(a, b)| a.centre().distance(b.centre())).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use surfel_core::{Intrinsics, Rigid};

    #[test]
    fn first_camera_is_the_origin_and_the_baseline_the_unit() {
        let camera = |t: DVec3| Camera {
            intrinsics: Intrinsics { fx: 1.0, fy: 1.0, cx: 0.5, cy: 0.5 },
            width: 1,
            height: 1,
            camera_from_world: Rigid::from_quat(DQuat::from_rotation_x(0.4), t),
        };
        let cameras = [camera(DVec3::new(1e5, 20.0, 3.0)), camera(DVec3::new(1e5 + 250.0, 20.0, 3.0))];
        let frame = working_from_scene(&cameras).unwrap();
        let moved: Vec<Camera> = cameras.iter().map(|c| c.in_frame(&frame)).collect();
        assert!(moved[0].centre().length() < 1e-6 && (moved[1].centre().length() - 1.0).abs() < 1e-6);
        assert!((moved[0].camera_from_world.rotation - DMat3::IDENTITY).to_cols_array().iter().all(|e| e.abs() < 1e-9));
        assert!(working_from_scene(&[cameras[0], cameras[0]]).is_none());
    }
}
