//! Chamfer distance of an object seen from a few views: depth maps or a mesh against reference points.
//!
//! A pair of photographs sees one side of an object, so only the reference points that an input view sees are
//! asked for. Invariant: distances are capped, never discarded; a hole costs the cap (20 mm on DTU).

use crate::chamfer::{Beyond, ChamferScore, chamfer};
use crate::depth_map::{DepthMap, is_depth};
use glam::DVec3;
use surfel_core::{Camera, Grid};

/// World points of every pixel of a depth map that has depth; `camera` is that of the depth raster.
///
/// # Panics
/// If the depth map and the camera differ in size.
pub fn back_projected(depth: &Grid<f32>, camera: &Camera) -> Vec<[f32; 3]> {
    assert!(depth.width() == camera.width && depth.height() == camera.height, "depth map and camera differ in size");
    let world_from_camera = camera.camera_from_world.inverse();
    let mut points = Vec::new();
    for y in 0..depth.height() {
        for (x, &z) in depth.row(y).iter().enumerate().filter(|&(_, &z)| is_depth(z)) {
            let ray = camera.ray(Camera::pixel_centre(x, y));
            points.push(world_from_camera.transform(ray * f64::from(z)).as_vec3().to_array());
        }
    }
    points
}

/// Reference points that at least one view sees: they project into its image and agree within `tolerance`
/// (relative) with its reference depth.
///
/// `views` pairs each reference depth map with the camera of that depth raster.
pub fn seen_points(points: &[[f32; 3]], views: &[(&Grid<f32>, Camera)], tolerance: f64) -> Vec<[f32; 3]> {
    let seen_by = |point: DVec3, depth: &Grid<f32>, camera: &Camera| {
        let Some((pixel, z)) = camera.project(point) else { return false };
        let surface = DepthMap::new(depth, &camera.intrinsics).lookup(pixel);
        surface.is_some_and(|surface| (f64::from(surface) - z).abs() <= tolerance * z)
    };
    let seen = |point: &&[f32; 3]| {
        let point = DVec3::from(point.map(f64::from));
        views.iter().any(|(depth, camera)| seen_by(point, depth, camera))
    };
    points.iter().filter(seen).copied().collect()
}

/// Chamfer distance of predicted against reference points with misses counted as `cap`, scene units.
pub fn object_chamfer(predicted: &[[f32; 3]], reference: &[[f32; 3]], cap: f64) -> ChamferScore {
    chamfer(predicted, reference, cap, Beyond::Cap)
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_core::{Intrinsics, Rigid};

    fn camera() -> Camera {
        let intrinsics = Intrinsics { fx: 80.0, fy: 80.0, cx: 40.0, cy: 30.0 };
        let rotation = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.8, 0.1);
        let camera_from_world = Rigid::from_quat(rotation, DVec3::new(5.0, -3.0, 100.0));
        Camera { intrinsics, width: 80, height: 60, camera_from_world }
    }

    #[test]
    fn back_projected_pixels_project_onto_themselves() {
        let depth = Grid::from_fn(80, 60, |x, y| if x % 3 == 0 { 0.0 } else { 500.0 + (x + 2 * y) as f32 });
        let points = back_projected(&depth, &camera());
        let valid: Vec<(usize, usize)> =
            (0..60).flat_map(|y| (0..80).map(move |x| (x, y))).filter(|&(x, y)| depth[(x, y)] > 0.0).collect();
        assert_eq!(points.len(), valid.len());
        for (point, (x, y)) in points.iter().zip(valid) {
            let (pixel, z) = camera().project(DVec3::from(point.map(f64::from))).unwrap();
            assert!((pixel - Camera::pixel_centre(x, y)).length() < 1e-3);
            assert!((z - f64::from(depth[(x, y)])).abs() < 1e-3);
        }
    }

    #[test]
    fn a_wall_one_millimetre_too_far_scores_one_and_a_hole_costs_the_cap() {
        let (near, far) = (Grid::filled(80, 60, 500.0f32), Grid::filled(80, 60, 501.0f32));
        let reference = back_projected(&near, &camera());
        let score = object_chamfer(&back_projected(&far, &camera()), &reference, 20.0);
        // The nearest point is on the perpendicular up to a pixel's spacing of 6 mm at the same ray.
        assert!(score.overall > 0.99 && score.overall < 1.3, "{score:?}");
        let mut holed = near.clone();
        for x in 0..80 {
            for y in 0..30 {
                holed[(x, y)] = 0.0;
            }
        }
        let score = object_chamfer(&back_projected(&holed, &camera()), &reference, 20.0);
        assert!(score.accuracy == 0.0 && score.completeness > 8.0 && score.completeness < 10.0, "{score:?}");
    }

    #[test]
    fn hidden_and_outside_points_are_not_asked_for() {
        let depth = Grid::filled(80, 60, 500.0f32);
        let camera = camera();
        let on = camera.unproject(glam::DVec2::new(40.0, 30.0), 500.0);
        let behind = camera.unproject(glam::DVec2::new(40.0, 30.0), 560.0);
        let outside = camera.unproject(glam::DVec2::new(-5.0, 30.0), 500.0);
        let points = [on, behind, outside].map(|p| p.as_vec3().to_array());
        assert_eq!(seen_points(&points, &[(&depth, camera)], 0.01), points[..1]);
    }
}
