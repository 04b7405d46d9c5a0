//! Camera rigs: where photographers stand.
//!
//! The world's up is +Z. Invariant: neighbouring cameras of an [`OrbitRig`] see the target under
//! exactly the pair angle, at exactly the distance.

use glam::{DMat3, DQuat, DVec3};
use surfel_core::{Camera, Intrinsics, Rigid};

/// The pose of a camera at `centre` that looks at `target`, its image upright for a world whose up is +Z.
pub fn look_at(centre: DVec3, target: DVec3) -> Rigid {
    let forward = (target - centre).normalize_or(DVec3::Y);
    // Straight up or down has no upright; any horizontal direction serves as the image's top.
    let up = if forward.z.abs() > 0.9999 { DVec3::Y } else { DVec3::Z };
    let right = forward.cross(up).normalize();
    let down = forward.cross(right);
    let rotation = DMat3::from_cols(right, down, forward).transpose();
    Rigid { rotation, translation: -(rotation * centre) }
}

/// A camera with square pixels, its principal point in the middle of the image.
pub fn centred_camera(width: usize, height: usize, focal: f64, camera_from_world: Rigid) -> Camera {
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: width as f64 / 2.0, cy: height as f64 / 2.0 };
    Camera { intrinsics, width, height, camera_from_world }
}

/// Cameras on an arc about a target, as a robot arm or a careful person takes them.
#[derive(Clone, Debug, PartialEq)]
pub struct OrbitRig {
    /// Image columns.
    pub width: usize,
    /// Image rows.
    pub height: usize,
    /// Focal length over image width; 1.8 for DTU.
    pub focal_per_width: f64,
    /// What all cameras look at, world frame.
    pub target: DVec3,
    /// Distance of every camera from the target, scene units.
    pub distance: f64,
    /// Angle at the target between neighbouring cameras, degrees.
    pub pair_angle_deg: f64,
    /// Where the middle of the arc stands, degrees about +Z from +X.
    pub azimuth_deg: f64,
    /// Height of the middle of the arc above the horizon, degrees.
    pub elevation_deg: f64,
}

impl OrbitRig {
    /// DTU's proportions in millimetres: target 650 mm away, neighbours 125 mm apart, focal 1.8 widths.
    pub fn dtu(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            focal_per_width: 1.8,
            target: DVec3::ZERO,
            distance: 650.0,
            pair_angle_deg: 0.0,
            azimuth_deg: -90.0,
            elevation_deg: 30.0,
        }
        .with_baseline(125.0)
    }

    /// The same rig with the pair angle at which neighbours stand `baseline` apart, scene units.
    pub fn with_baseline(self, baseline: f64) -> Self {
        let half_angle = (0.5 * baseline / self.distance).clamp(-1.0, 1.0).asin();
        Self { pair_angle_deg: 2.0 * half_angle.to_degrees(), ..self }
    }

    /// `count` cameras from left to right, the arc centred on the rig's azimuth.
    pub fn cameras(&self, count: usize) -> Vec<Camera> {
        (0..count).map(|i| self.camera_at(i as f64, count)).collect()
    }

    /// A camera on the arc of `count`, `place` pair angles from the first of them; may lie between two or beside all.
    pub fn camera_at(&self, place: f64, count: usize) -> Camera {
        let (azimuth, elevation) = (self.azimuth_deg.to_radians(), self.elevation_deg.to_radians());
        let middle = DVec3::new(azimuth.cos() * elevation.cos(), azimuth.sin() * elevation.cos(), elevation.sin());
        let up = -look_at(middle, DVec3::ZERO).rotation.row(1);
        let step = place - 0.5 * (count as f64 - 1.0);
        let turn = DQuat::from_axis_angle(up, (step * self.pair_angle_deg).to_radians());
        let centre = self.target + turn * middle * self.distance;
        let focal = self.focal_per_width * self.width as f64;
        centred_camera(self.width, self.height, focal, look_at(centre, self.target))
    }
}

/// Cameras on a short straight path with a slight turn, as in a walk through a room.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkRig {
    /// Image columns.
    pub width: usize,
    /// Image rows.
    pub height: usize,
    /// Focal length over image width; about 0.9 for RealEstate10K.
    pub focal_per_width: f64,
    /// Where the first camera stands, world frame.
    pub start: DVec3,
    /// What the first camera looks at, world frame.
    pub target: DVec3,
    /// Displacement from one camera to the next, world frame, scene units.
    pub step: DVec3,
    /// Turn from one camera to the next, degrees about the world's +Z.
    pub turn_deg: f64,
}

impl WalkRig {
    /// `count` cameras along the path.
    pub fn cameras(&self, count: usize) -> Vec<Camera> {
        (0..count).map(|i| self.camera_at(i as f64)).collect()
    }

    /// A camera on the path, `place` steps from the first; may lie between two or beside all.
    pub fn camera_at(&self, place: f64) -> Camera {
        let centre = self.start + self.step * place;
        let turn = DQuat::from_rotation_z((self.turn_deg * place).to_radians());
        let target = centre + turn * (self.target - self.start);
        let focal = self.focal_per_width * self.width as f64;
        centred_camera(self.width, self.height, focal, look_at(centre, target))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dtu_pair_has_its_distance_baseline_and_looks_upright_at_the_target() {
        let cameras = OrbitRig::dtu(320, 256).cameras(2);
        let [a, b] = [&cameras[0], &cameras[1]];
        assert!(((a.centre() - b.centre()).length() - 125.0).abs() < 1e-9);
        for camera in [a, b] {
            let (pixel, depth) = camera.project(DVec3::ZERO).unwrap();
            assert!((depth - 650.0).abs() < 1e-9);
            assert!((pixel - glam::DVec2::new(160.0, 128.0)).length() < 1e-9);
            let (above, _) = camera.project(DVec3::Z * 10.0).unwrap();
            assert!(above.y < 127.0 && (above.x - 160.0).abs() < 1e-9, "+Z is up in the image");
        }
        let between = OrbitRig::dtu(320, 256).camera_at(0.5, 2).centre();
        assert!(((a.centre() - between).length() - (b.centre() - between).length()).abs() < 1e-9);
        assert!((between.length() - 650.0).abs() < 1e-9);
        let seen_by_left = a.camera_from_world.transform(b.centre());
        assert!(seen_by_left.x > 0.0, "the second camera stands to the right of the first");
    }

    #[test]
    fn walk_moves_by_its_step() {
        let rig = WalkRig {
            width: 64,
            height: 48,
            focal_per_width: 0.9,
            start: DVec3::new(0.0, 0.0, 1.5),
            target: DVec3::new(3.0, 0.0, 1.2),
            step: DVec3::new(0.0, 0.1, 0.0),
            turn_deg: 1.0,
        };
        let cameras = rig.cameras(3);
        assert!((cameras[2].centre() - DVec3::new(0.0, 0.2, 1.5)).length() < 1e-12);
        let between = rig.camera_at(0.5).centre();
        assert!((between - DVec3::new(0.0, 0.05, 1.5)).length() < 1e-12);
        let turned = cameras[0].forward().angle_between(cameras[1].forward()).to_degrees();
        assert!((turned - 1.0).abs() < 0.01, "{turned}");
    }
}
