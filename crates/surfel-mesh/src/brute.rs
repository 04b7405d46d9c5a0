//! The slow obvious twins: a dense field straight from the formula, and marching cubes one cube at a time.
//!
//! For tests. They share the case table, the definition of the grid and the rule of what is one surface with the fast
//! path, and nothing else.

use crate::{
    DepthView, Tsdf, TsdfConfig,
    cases::{CASES, edge_corners},
    continuity::Continuity,
    extract::is_torn,
    tsdf::lattice_of,
    vertex::crossing,
};
use glam::{DVec2, DVec3, IVec3};
use std::collections::HashMap;
use surfel_core::Grid;

/// Field values, in local voxels, of every voxel from `low` up to and excluding `high`; `None` where
/// unobserved. The twin of [`crate::fuse`], in double precision.
pub fn dense_field(views: &[DepthView<'_>], config: &TsdfConfig, low: IVec3, high: IVec3) -> HashMap<IVec3, f64> {
    let lattice = lattice_of(views, config);
    let truncation = config.truncation / config.voxel;
    let mut field = HashMap::new();
    for z in low.z..high.z {
        for y in low.y..high.y {
            for x in low.x..high.x {
                let voxel = IVec3::new(x, y, z);
                let offset = lattice.offset_from_grid(voxel.as_dvec3());
                let (mut sum, mut total) = (0.0, 0.0);
                for view in views {
                    let pixels = Pixels {
                        view,
                        continuity: Continuity::new(config.max_depth_jump, view.camera.intrinsics.mean_focal()),
                    };
                    let Some((pixel, z)) = view.camera.project(lattice.world_from_offset(offset)) else {
                        continue;
                    };
                    let Some((depth, weight, nearest)) = pixels.sample(pixel - 0.5) else {
                        continue;
                    };
                    let distance =
                        pixels.shrink(nearest, truncation) * (depth - z) / (config.voxel * lattice.spacing(offset));
                    if distance >= -truncation {
                        sum += weight * distance.min(truncation);
                        total += weight;
                    }
                }
                if total > 0.0 {
                    field.insert(voxel, sum / total);
                }
            }
        }
    }
    field
}

/// The pixels of a view in double precision, by the rules of the fast path.
struct Pixels<'a> {
    view: &'a DepthView<'a>,
    continuity: Continuity,
}

impl Pixels<'_> {
    fn weight(&self, at: DVec2) -> Option<f64> {
        self.view.weight.map_or(Some(1.0), |weight| usable(weight, at))
    }

    /// Inverse depth of a pixel, index coordinates.
    fn inverse(&self, at: DVec2) -> Option<f64> {
        usable(self.view.depth, at).filter(|_| self.weight(at).is_some()).map(|depth| 1.0 / depth)
    }

    /// Whether a pixel and the one a `step` further are one surface.
    fn joins(&self, at: DVec2, step: DVec2) -> bool {
        let inverse = |steps: f64| self.inverse(at + step * steps).unwrap_or(0.0);
        self.continuity.joins(inverse(0.0), inverse(1.0), || [inverse(-1.0), inverse(2.0)])
    }

    /// Slope of inverse depth along a step, from those neighbours that are on the pixel's surface.
    fn slope(&self, at: DVec2, step: DVec2) -> Option<f64> {
        let rise = |from: DVec2| Some(self.inverse(from + step)? - self.inverse(from)?);
        let rises: Vec<f64> =
            [at - step, at].into_iter().filter(|from| self.joins(*from, step)).filter_map(rise).collect();
        (!rises.is_empty()).then(|| rises.iter().sum::<f64>() / rises.len() as f64)
    }

    /// Depth and weight at index coordinates, and the pixel they are of.
    fn sample(&self, at: DVec2) -> Option<(f64, f64, DVec2)> {
        let nearest = (at + 0.5).floor();
        let (corner, part) = (at.floor(), at - at.floor());
        let [right, below] = [corner + DVec2::X, corner + DVec2::Y];
        let sides = [(corner, DVec2::X), (below, DVec2::X), (corner, DVec2::Y), (right, DVec2::Y)];
        let inverse = if sides.iter().all(|(from, step)| self.joins(*from, *step)) {
            let [top, bottom] = [corner, below]
                .map(|from| Some((1.0 - part.x) * self.inverse(from)? + part.x * self.inverse(from + DVec2::X)?));
            (1.0 - part.y) * top? + part.y * bottom?
        } else {
            let beside = at - nearest;
            let slope = |step| self.slope(nearest, step).unwrap_or(0.0);
            self.inverse(nearest)? + slope(DVec2::X) * beside.x + slope(DVec2::Y) * beside.y
        };
        Some((1.0 / inverse, self.weight(nearest)?, nearest))
    }

    /// What a distance along z counts at a pixel: at a grazing angle so little that a band of `truncation` along z is a
    /// voxel's diagonal thick across the surface. The surface is the plane through three points beside the pixel.
    fn shrink(&self, at: DVec2, truncation: f64) -> f64 {
        let plane = || {
            let (here, across, down) = (self.inverse(at)?, self.slope(at, DVec2::X)?, self.slope(at, DVec2::Y)?);
            let point = |step: DVec2, inverse: f64| self.view.camera.ray(at + 0.5 + step) / inverse;
            // Small steps, so that the plane does not meet infinity on the way.
            let [a, b] = [(DVec2::X, across), (DVec2::Y, down)]
                .map(|(step, slope)| point(step * 1e-3, here + slope * 1e-3) - point(DVec2::ZERO, here));
            let ray = self.view.camera.ray(at + 0.5);
            Some(a.cross(b).normalize().dot(ray).abs())
        };
        plane().map_or(1.0, |cosine| (cosine.max(0.05) * truncation / 3.0_f64.sqrt()).min(1.0))
    }
}

/// A finite positive value of a pixel.
fn usable(grid: &Grid<f32>, at: DVec2) -> Option<f64> {
    let value = grid.get(at.x as isize, at.y as isize).copied().unwrap_or(0.0);
    (value.is_finite() && value > 0.0).then_some(f64::from(value))
}

/// The triangles of a fused field as loose corner positions, cube by cube over the whole bounding box: the
/// twin of [`Tsdf::extract`], which shares vertices.
pub fn triangle_soup(tsdf: &Tsdf<'_>) -> Vec<[[f32; 3]; 3]> {
    let Some((low, high)) = tsdf.bounds() else {
        return Vec::new();
    };
    let mut soup = Vec::new();
    for z in low.z..high.z {
        for y in low.y..high.y {
            for x in low.x..high.x {
                let voxel = |corner: u8| {
                    let corner = i32::from(corner);
                    IVec3::new(x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2))
                };
                let values: Vec<f32> = (0..8).filter_map(|corner| tsdf.value(voxel(corner))).collect();
                let Ok(values) = <[f32; 8]>::try_from(values) else {
                    continue;
                };
                let case = (0..8u8).fold(0, |case, c| case | u8::from(values[c as usize] < 0.0) << c);
                if is_torn(&values, case, tsdf.truncation) {
                    continue;
                }
                let position = |edge: u8| {
                    let [a, b] = edge_corners(edge);
                    let along = crossing(values[a as usize], values[b as usize]);
                    let grid: DVec3 = voxel(a).as_dvec3().lerp(voxel(b).as_dvec3(), f64::from(along));
                    tsdf.lattice.world_from_offset(tsdf.lattice.offset_from_grid(grid)).as_vec3().to_array()
                };
                soup.extend(CASES[case as usize].iter().map(|triangle| triangle.map(position)));
            }
        }
    }
    soup
}
