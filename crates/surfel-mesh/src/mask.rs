//! Removes the depths a fused surface should not be built from: image borders, depth edges and surfaces seen
//! at a grazing angle (spec 6.2 step 2).
//!
//! Runs on one rendered map before fusion. Invariant: a pixel is only ever removed, never changed, and each
//! removal is counted once, under the first reason in the order of [`MaskCounts`].

use crate::{continuity::Continuity, normals_to_the_rim, view::is_depth};
use surfel_core::{Camera, Grid};

/// What counts as unreliable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaskConfig {
    /// Largest angle between the normal and the direction to the camera, degrees; 90 or more keeps all.
    pub max_angle_deg: f64,
    /// Largest difference to the four neighbours, as a fraction of the nearer depth, unless both lie on a plane that
    /// is seen at a grazing angle; infinite keeps all.
    pub max_depth_jump: f64,
    /// Width of the frame of pixels removed along the image border, pixels.
    pub border: usize,
}

impl Default for MaskConfig {
    fn default() -> Self {
        Self { max_angle_deg: 84.0, max_depth_jump: 0.02, border: 1 }
    }
}

impl MaskConfig {
    /// Removes nothing but pixels without usable depth.
    pub const KEEP_ALL: Self = Self { max_angle_deg: 90.0, max_depth_jump: f64::INFINITY, border: 0 };
}

/// Pixels removed from one map, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MaskCounts {
    /// Had no depth to begin with: zero, negative or not finite.
    pub without_depth: usize,
    /// In the frame along the border.
    pub border: usize,
    /// At a jump to a neighbour.
    pub depth_edge: usize,
    /// Seen at a grazing angle.
    pub grazing: usize,
    /// Left over.
    pub kept: usize,
}

/// The depth map with unreliable pixels set to 0, and the count of what was removed.
///
/// `normals` are unit normals in the camera frame; without them [`normals_to_the_rim`] takes them from
/// the depth map. Pixels whose normal is unknown are not judged by angle. Expects `depth` (and `normals`) at the camera's size.
pub fn mask_unreliable(
    depth: &Grid<f32>,
    camera: &Camera,
    normals: Option<&Grid<Option<[f32; 3]>>>,
    config: &MaskConfig,
) -> (Grid<f32>, MaskCounts) {
    let own_normals = normals.is_none().then(|| normals_to_the_rim(depth, &camera.intrinsics));
    let normals = normals.or(own_normals.as_ref());
    let min_facing = config.max_angle_deg.clamp(0.0, 90.0).to_radians().cos();
    let continuity = Continuity::new(config.max_depth_jump, camera.intrinsics.mean_focal());
    let mut counts = MaskCounts::default();
    let masked = Grid::from_fn(depth.width(), depth.height(), |x, y| {
        let normal = normals.and_then(|normals| normals.get(x as isize, y as isize).copied().flatten());
        let reason = if !is_depth(depth[(x, y)]) {
            &mut counts.without_depth
        } else if in_border(depth, x, y, config.border) {
            &mut counts.border
        } else if at_edge(depth, x, y, continuity) {
            &mut counts.depth_edge
        } else if config.max_angle_deg < 90.0 && normal.is_some_and(|n| facing(camera, x, y, n) < min_facing) {
            &mut counts.grazing
        } else {
            counts.kept += 1;
            return depth[(x, y)];
        };
        *reason += 1;
        0.0
    });
    (masked, counts)
}

/// Cosine of the angle between a unit camera-frame normal and the direction from the surface to the camera.
pub fn facing(camera: &Camera, x: usize, y: usize, normal: [f32; 3]) -> f64 {
    let ray = camera.ray(Camera::pixel_centre(x, y)).normalize();
    -ray.dot(glam::Vec3::from(normal).as_dvec3())
}

fn in_border(depth: &Grid<f32>, x: usize, y: usize, border: usize) -> bool {
    x < border || y < border || x + border >= depth.width() || y + border >= depth.height()
}

/// True when one of the four neighbours that have depth is on another surface.
fn at_edge(depth: &Grid<f32>, x: usize, y: usize, continuity: Continuity) -> bool {
    let inverse = |dx: isize, dy: isize| {
        let z = depth.get(x as isize + dx, y as isize + dy).copied().filter(|&z| is_depth(z));
        z.map_or(0.0, |z| 1.0 / f64::from(z))
    };
    [(-1, 0), (1, 0), (0, -1), (0, 1)].into_iter().any(|(dx, dy)| {
        let along = |steps: isize| inverse(steps * dx, steps * dy);
        along(1) > 0.0 && !continuity.joins(along(0), along(1), || [along(-1), along(2)])
    })
}
