//! The slow obvious twins: a dense field straight from the formula, and marching cubes one cube at a time.
//!
//! For tests. They share the case table and the definition of the grid with the fast path and nothing else.

use crate::{
    DepthView, Tsdf, TsdfConfig,
    cases::{CASES, edge_corners},
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
                    let Some((pixel, z)) = view.camera.project(lattice.world_from_offset(offset)) else {
                        continue;
                    };
                    let Some((depth, weight)) = depth_at(view, pixel - 0.5, config.max_depth_jump) else {
                        continue;
                    };
                    let distance = (depth - z) / (config.voxel * lattice.spacing(offset));
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

/// Depth and weight at index coordinates, by the rule of the fast path.
fn depth_at(view: &DepthView<'_>, pixel: DVec2, max_jump: f64) -> Option<(f64, f64)> {
    let usable = |grid: &Grid<f32>, x: f64, y: f64| {
        let value = grid.get(x as isize, y as isize).copied().unwrap_or(0.0);
        (value.is_finite() && value > 0.0).then_some(f64::from(value))
    };
    let weight = |x, y| view.weight.map_or(Some(1.0), |weight| usable(weight, x, y));
    let depth = |x, y| usable(view.depth, x, y).filter(|_| weight(x, y).is_some());
    let nearest = (pixel + 0.5).floor();
    if nearest.min_element() < 0.0 || nearest.x >= view.camera.width as f64 || nearest.y >= view.camera.height as f64 {
        return None;
    }
    let corner = pixel.floor();
    let part = pixel - corner;
    let square: Vec<f64> = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]
        .iter()
        .filter_map(|(x, y)| depth(corner.x + x, corner.y + y))
        .collect();
    let near = square.iter().copied().fold(f64::INFINITY, f64::min);
    let far = square.iter().copied().fold(0.0, f64::max);
    let inverse = if square.len() == 4 && far <= near * (1.0 + max_jump) {
        let top = (1.0 - part.x) / square[0] + part.x / square[1];
        let bottom = (1.0 - part.x) / square[2] + part.x / square[3];
        (1.0 - part.y) * top + part.y * bottom
    } else {
        let here = depth(nearest.x, nearest.y)?;
        let slope = |step: DVec2| {
            let rises: Vec<f64> = [-1.0, 1.0]
                .iter()
                .filter_map(|sign| {
                    let at = nearest + step * *sign;
                    let there = depth(at.x, at.y)?;
                    let same = here.max(there) <= here.min(there) * (1.0 + max_jump);
                    same.then_some(sign * (1.0 / there - 1.0 / here))
                })
                .collect();
            rises.iter().sum::<f64>() / rises.len().max(1) as f64
        };
        let beside = pixel - nearest;
        1.0 / here + slope(DVec2::X) * beside.x + slope(DVec2::Y) * beside.y
    };
    let depth = 1.0 / inverse;
    Some((depth, weight(nearest.x, nearest.y)?))
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
