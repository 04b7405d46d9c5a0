//! One surfel per pixel and view: the fourth step of the road.
//!
//! Centre from the depth, tangent frame from the normal, scale from the pixel's footprint after the Nyquist
//! adaptation (spec 1.9, consistent form), opacity from the confidence, colour as SH degree 0. Invariant:
//! after the adaptation no surfel is finer than the multi-view sampling rate allows
//! (`frequency_ratio <= 2 / (pi s)`).

use glam::{DMat3, DQuat, DVec3};
use surfel_core::nyquist::{NyquistMode, adapt, multi_view_rate, sampling_rate};
use surfel_core::{Camera, Grid, Surfels, View, sh};
use surfel_stereo::DepthEstimate;

/// How pixels become surfels; lengths are in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelConfig {
    /// Standard deviation of a pixel's footprint before the adaptation.
    pub footprint_px: f64,
    /// Standard deviation `s` of the low-pass kernel, in pixels of the finest view.
    pub low_pass_px: f64,
    /// Smallest cosine between normal and ray: beyond, a footprint is not stretched further.
    pub min_cosine: f64,
    /// Opacity of a surfel of confidence 0 and 1.
    pub opacity: (f32, f32),
    /// Share of the image size by which the visibility test of the sampling rate enlarges the image (spec 1.9.6).
    pub visibility_margin: f64,
}

impl Default for SurfelConfig {
    fn default() -> Self {
        Self { footprint_px: 0.3, low_pass_px: 1.0, min_cosine: 0.2, opacity: (0.02, 0.98), visibility_margin: 0.15 }
    }
}

/// The surfels of all views, view-major then row-major, in the frame of the cameras. Pixels without depth give none.
pub fn surfels_from_depth(views: &[View], estimates: &[DepthEstimate], config: &SurfelConfig) -> Surfels {
    let cameras: Vec<&Camera> = views.iter().map(|view| &view.camera).collect();
    let mut surfels = Surfels { sh_degree: 0, ..Surfels::default() };
    for (home, (view, estimate)) in views.iter().zip(estimates).enumerate() {
        append_view(&mut surfels, &cameras, home, &view.image, estimate, config);
    }
    surfels
}

fn append_view(
    surfels: &mut Surfels,
    cameras: &[&Camera],
    home: usize,
    image: &Grid<[f32; 3]>,
    estimate: &DepthEstimate,
    config: &SurfelConfig,
) {
    let camera = cameras[home];
    let world_from_camera = camera.camera_from_world.inverse();
    for y in 0..image.height() {
        for x in 0..image.width() {
            let depth = f64::from(estimate.depth[(x, y)]);
            if depth <= 0.0 {
                continue;
            }
            let ray = camera.ray(Camera::pixel_centre(x, y));
            let centre = world_from_camera.transform(ray * depth);
            let normal = DVec3::from(estimate.normal[(x, y)].map(f64::from)).normalize_or(DVec3::NEG_Z);
            let frame = tangent_frame(normal, ray);
            let rate = rate_at(cameras, home, centre, config.visibility_margin);
            let pixel = depth / camera.intrinsics.mean_focal() * config.footprint_px;
            let cosine = normal.dot(ray.normalize()).abs().max(config.min_cosine);
            let low_passed = |scale: f64| adapt(NyquistMode::Consistent, scale, rate, config.low_pass_px) as f32;
            // The footprint of a pixel on a slanted surface is longer along the slant, which is t_u.
            surfels.scales.push([low_passed(pixel / cosine), low_passed(pixel)]);
            surfels.centres.push(centre.as_vec3().to_array());
            let q = DQuat::from_mat3(&(world_from_camera.rotation * frame)).normalize();
            surfels.rotations.push([q.w as f32, q.x as f32, q.y as f32, q.z as f32]);
            let (low, high) = config.opacity;
            surfels.opacities.push(low + (high - low) * estimate.confidence[(x, y)].clamp(0.0, 1.0));
            surfels.sh.push(sh::from_colour(image[(x, y)]));
        }
    }
}

/// Columns `t_u, t_v, t_w`, camera frame: `t_w` the normal, `t_u` down the slant as seen along `ray`.
fn tangent_frame(normal: DVec3, ray: DVec3) -> DMat3 {
    let slant = ray - normal * ray.dot(normal);
    // Seen head on there is no slant, only rounding.
    let is_slanted = slant.length_squared() > 1e-16 * ray.length_squared();
    let t_u = if is_slanted { slant.normalize() } else { normal.any_orthonormal_vector() };
    DMat3::from_cols(t_u, normal.cross(t_u), normal)
}

/// Finest sampling rate over the views that see `centre`; the home view always does.
fn rate_at(cameras: &[&Camera], home: usize, centre: DVec3, margin: f64) -> f64 {
    multi_view_rate(cameras.iter().enumerate().filter_map(|(index, camera)| {
        let (pixel, z) = camera.project(centre)?;
        let (mx, my) = (margin * camera.width as f64, margin * camera.height as f64);
        let seen =
            pixel.x > -mx && pixel.y > -my && pixel.x < camera.width as f64 + mx && pixel.y < camera.height as f64 + my;
        let k = &camera.intrinsics;
        (seen || index == home).then(|| sampling_rate(NyquistMode::Consistent, k.fx, k.fy, z))
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;
    use surfel_core::nyquist::frequency_ratio;
    use surfel_core::{Intrinsics, Rigid};

    fn wall(scale: f64) -> (Vec<View>, Vec<DepthEstimate>) {
        let intrinsics = Intrinsics { fx: 40.0, fy: 42.0, cx: 12.0, cy: 9.0 };
        let camera = |x: f64| Camera {
            intrinsics,
            width: 24,
            height: 18,
            camera_from_world: Rigid { translation: DVec3::new(x * scale, 0.0, 0.5 * x * scale), ..Rigid::IDENTITY },
        };
        let n = DVec3::new(0.3, 0.1, -0.9).normalize().as_vec3().to_array();
        let estimate = DepthEstimate {
            depth: Grid::filled(24, 18, (2.0 * scale) as f32),
            normal: Grid::filled(24, 18, n),
            confidence: Grid::filled(24, 18, 0.5),
            num_candidates: 2,
            planes: Grid::filled(24, 18, Default::default()),
            correction: Grid::filled(24, 18, Default::default()),
            step: 1.0,
        };
        let view = |x: f64| View::new("v", Grid::filled(24, 18, [0.2, 0.4, 0.6]), camera(x));
        (vec![view(0.0), view(-0.3)], vec![estimate.clone(), estimate])
    }

    #[test]
    fn no_surfel_is_above_the_nyquist_rate_at_any_scale() {
        for scale in [1.0, 1000.0, 0.005] {
            let (views, estimates) = wall(scale);
            let config = SurfelConfig::default();
            let surfels = surfels_from_depth(&views, &estimates, &config);
            let cameras: Vec<&Camera> = views.iter().map(|v| &v.camera).collect();
            for (k, (centre, scales)) in surfels.centres.iter().zip(&surfels.scales).enumerate() {
                let home = k / (24 * 18);
                let rate = rate_at(&cameras, home, glam::Vec3::from(*centre).as_dvec3(), config.visibility_margin);
                for s in scales {
                    assert!(frequency_ratio(f64::from(*s), rate) <= 2.0 / (PI * config.low_pass_px) * (1.0 + 1e-5));
                }
            }
        }
    }

    #[test]
    fn tangents_lie_in_the_surface() {
        let normal = DVec3::new(0.3, -0.2, -0.8).normalize();
        for ray in [DVec3::new(0.1, 0.2, 1.0), -normal] {
            let frame = tangent_frame(normal, ray);
            assert!((frame.determinant() - 1.0).abs() < 1e-12);
            assert!((frame.transpose() * frame - DMat3::IDENTITY).to_cols_array().iter().all(|e| e.abs() < 1e-12));
            assert_eq!(frame.z_axis, normal);
        }
    }
}
