//! What of the maps the surface may be made of: solid, believed, and near enough to be measured.
//!
//! Between rendering and the mesh. Invariant: a pixel is only ever left out, never changed, and what is left out for its
//! distance alone is counted.

use super::maps::ViewMaps;
use surfel_core::{Camera, Grid};
use surfel_mesh::{facing, normals_to_the_rim};

/// Alpha from which a rendered pixel counts as surface.
const SOLID: f32 = 0.5;

/// Angle between line of sight and normal from which a surface is seen grazing, degrees.
const GRAZING_DEG: f64 = 80.0;

/// From where a surface is, the two cameras farthest from each other must stand at least this many pixels apart. Below,
/// matches, good to a fraction of a pixel, cannot tell a hill from the sky, and a mesh would carry a shell around the
/// scene at a distance that nobody measured.
const LEAST_PARALLAX: f64 = 2.0;

/// Confidence that a pixel must have to become surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeastConfidence {
    /// Any pixel.
    pub anywhere: f32,
    /// A pixel that would show a surface at a grazing angle. Ground does, but the smear of an edge between two surfaces
    /// looks the same.
    pub grazing: f32,
}

/// Depth of one view that a mesh may be made of.
#[derive(Clone, Debug)]
pub struct SolidDepth {
    /// z-depth, working units; 0 = none.
    pub depth: Grid<f32>,
    /// Pixels left out only because they are too far away to be measured.
    pub num_too_far: usize,
}

/// Depth of the pixels of `camera` that surfels cover, that are believed and near enough to be measured, working frame.
pub fn solid_depth(maps: &ViewMaps, camera: &Camera, confidence: &Grid<f32>, least: LeastConfidence) -> SolidDepth {
    let normals = normals_to_the_rim(&maps.depth, &camera.intrinsics);
    let steepest = GRAZING_DEG.to_radians().cos();
    let farthest = measurable_depth(camera);
    let mut num_too_far = 0;
    let depth = Grid::from_fn(maps.alpha.width(), maps.alpha.height(), |x, y| {
        let z = maps.depth[(x, y)];
        let grazing = normals[(x, y)].is_some_and(|normal| facing(camera, x, y, normal) < steepest);
        let least = if grazing { least.grazing } else { least.anywhere };
        let solid = maps.alpha[(x, y)] >= SOLID && confidence[(x, y)] >= least;
        let too_far = f64::from(z) > farthest;
        num_too_far += usize::from(solid && too_far);
        if solid && !too_far { z } else { 0.0 }
    });
    SolidDepth { depth, num_too_far }
}

/// Largest z-depth from which the cameras are seen [`LEAST_PARALLAX`] of this camera's pixels apart, working units: the
/// longest baseline is one.
fn measurable_depth(camera: &Camera) -> f64 {
    camera.intrinsics.mean_focal() / LEAST_PARALLAX
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use surfel_core::{Intrinsics, Rigid};

    const LEAST: LeastConfidence = LeastConfidence { anywhere: 0.2, grazing: 0.5 };

    fn camera() -> Camera {
        let intrinsics = Intrinsics { fx: 500.0, fy: 500.0, cx: 2.0, cy: 0.5 };
        Camera { intrinsics, width: 4, height: 3, camera_from_world: Rigid::IDENTITY }
    }

    /// Three rows of the same four numbers.
    fn rows(values: [f32; 4]) -> Grid<f32> {
        Grid::from_fn(4, 3, |x, _| values[x])
    }

    fn maps(depth: [f32; 4], alpha: [f32; 4]) -> ViewMaps {
        ViewMaps {
            depth: rows(depth),
            normal: Grid::filled(4, 3, [0.0, 0.0, -1.0]),
            alpha: rows(alpha),
            colour: Grid::filled(4, 3, [0.5; 3]),
        }
    }

    #[test]
    fn what_is_thin_or_doubtful_is_a_hole() {
        let maps = maps([2.0; 4], [0.9, 0.4, 0.9, 0.5]);
        let confidence = rows([0.8, 0.8, 0.1, 0.2]);
        let solid = |anywhere| solid_depth(&maps, &camera(), &confidence, LeastConfidence { anywhere, ..LEAST });
        assert_eq!(solid(0.2).depth, rows([2.0, 0.0, 0.0, 2.0]));
        assert_eq!(solid(0.0).depth, rows([2.0, 0.0, 2.0, 2.0]));
        assert_eq!(solid(0.2).num_too_far, 0);
    }

    #[test]
    fn what_is_seen_grazing_must_be_believed_more() {
        // Two per cent from pixel to pixel is ten times as deep as wide: 84 degrees.
        let maps = maps([2.0, 2.04, 2.08, 2.12], [1.0; 4]);
        let solid = |confidence| solid_depth(&maps, &camera(), &rows([confidence; 4]), LEAST).depth;
        assert_eq!(solid(0.4), rows([0.0; 4]));
        assert_eq!(solid(0.6), maps.depth);
    }

    #[test]
    fn what_is_too_far_to_measure_is_a_hole_and_counted() {
        let farthest = measurable_depth(&camera());
        let other = Camera { camera_from_world: Rigid::from_quat(DQuat::IDENTITY, DVec3::X), ..camera() };
        let point = DVec3::new(0.0, 0.0, farthest);
        let parallax = (other.project(point).unwrap().0 - camera().project(point).unwrap().0).x;
        assert!((parallax - LEAST_PARALLAX).abs() < 1e-12, "{parallax}");
        // The last is thin: it is no surface, so it is not counted as a far one.
        let maps = maps([249.0, 249.0, 251.0, 390.0], [1.0, 1.0, 1.0, 0.1]);
        let solid = solid_depth(&maps, &camera(), &rows([1.0; 4]), LEAST);
        assert_eq!(solid.depth, rows([249.0, 249.0, 0.0, 0.0]));
        assert_eq!(solid.num_too_far, 3);
    }
}
