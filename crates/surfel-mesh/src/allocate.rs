//! Which blocks of voxels the depth maps touch.
//!
//! Each pixel claims the blocks met by its surface patch and the truncation band behind it, so a pixel wider
//! than a block claims all the blocks it covers and no hole can open between pixels. The band in front needs
//! no blocks: a fused surface always lies on or behind the surface of some view. Invariant: the result is
//! sorted and free of repeats, whatever the number of threads.

use crate::{MeshError, TsdfConfig, lattice::Lattice, observer::Observer};
use glam::{DVec3, IVec3};
use rayon::prelude::*;

/// Voxels along the edge of a block.
pub(crate) const BLOCK: i32 = 8;
/// Voxels in a block.
pub(crate) const BLOCK_VOXELS: usize = (BLOCK * BLOCK * BLOCK) as usize;
/// A voxel at a crossing, its neighbour across the edge, and one more for the gradient.
const MARGIN: f64 = 2.0;
/// Grid coordinates stay below this, far inside `i32`.
const MAX_COORDINATE: f64 = (1 << 28) as f64;

/// Sort key of a block: z, y, x, as the blocks lie in memory.
pub(crate) fn order(block: &IVec3) -> [i32; 3] {
    [block.z, block.y, block.x]
}

/// The blocks to integrate into, in [`order`].
pub(crate) fn touched_blocks(
    observers: &[Observer<'_>],
    lattice: &Lattice,
    config: &TsdfConfig,
) -> Result<Vec<IVec3>, MeshError> {
    let max_blocks = config.max_bytes / (BLOCK_VOXELS * size_of::<f32>());
    let too_many = |num_blocks: usize| MeshError::TooManyBlocks {
        needed_mib: (num_blocks * BLOCK_VOXELS * size_of::<f32>()) >> 20,
        limit_mib: config.max_bytes >> 20,
        voxel: lattice.voxel,
    };
    let mut blocks = Vec::new();
    for observer in observers {
        let rows: Result<Vec<Vec<IVec3>>, usize> = (0..observer.height)
            .into_par_iter()
            .map(|y| {
                let row = blocks_of_row(observer, lattice, config, y, max_blocks);
                if row.len() > max_blocks { Err(row.len()) } else { Ok(row) }
            })
            .collect();
        for row in rows.map_err(too_many)? {
            blocks.extend(row);
            // Bounds the list of repeats by a small multiple of what may be allocated.
            if blocks.len() > 4 * max_blocks {
                sort_and_dedup(&mut blocks);
                if blocks.len() > max_blocks {
                    return Err(too_many(blocks.len()));
                }
            }
        }
    }
    sort_and_dedup(&mut blocks);
    if blocks.len() > max_blocks { Err(too_many(blocks.len())) } else { Ok(blocks) }
}

fn sort_and_dedup(blocks: &mut Vec<IVec3>) {
    blocks.sort_unstable_by_key(order);
    blocks.dedup();
}

fn blocks_of_row(
    observer: &Observer<'_>,
    lattice: &Lattice,
    config: &TsdfConfig,
    y: usize,
    max_blocks: usize,
) -> Vec<IVec3> {
    let mut blocks = Vec::new();
    let mut previous = None;
    for x in 0..observer.width {
        let Some((low, high)) = block_box(observer, lattice, config, x, y) else {
            continue;
        };
        if previous == Some((low, high)) {
            continue;
        }
        previous = Some((low, high));
        for bz in low.z..=high.z {
            for by in low.y..=high.y {
                blocks.extend((low.x..=high.x).map(|bx| IVec3::new(bx, by, bz)));
            }
        }
        if blocks.len() > 2 * max_blocks {
            sort_and_dedup(&mut blocks);
            if blocks.len() > max_blocks {
                break;
            }
        }
    }
    sort_and_dedup(&mut blocks);
    blocks
}

/// First and last block, per axis, of what a pixel claims.
fn block_box(
    observer: &Observer<'_>,
    lattice: &Lattice,
    config: &TsdfConfig,
    x: usize,
    y: usize,
) -> Option<(IVec3, IVec3)> {
    let depth = observer.pixel_depth(x, y)?;
    let half_rise = half_rise(observer, x, y, depth);
    let [fx, fy] = observer.focal.map(f64::from);
    let [cx, cy] = observer.principal.map(f64::from);
    let ray = DVec3::new((x as f64 - cx) / fx, (y as f64 - cy) / fy, 1.0);
    let offset_at = |z: f64| observer.rotation.transpose() * (ray * z - observer.translation);
    let surface = offset_at(depth);
    let truncation = config.truncation / lattice.voxel * lattice.spacing(surface) / f64::from(observer.shrink(x, y));
    let ends = [offset_at(depth - half_rise), surface, offset_at(depth + half_rise + truncation)];
    let ends = ends.map(|offset| lattice.grid_from_offset(offset));
    // Half a pixel to each side, its diagonal, and the stretch of the compressed part.
    let half_pixel = 0.5 * depth / fx.min(fy) * std::f64::consts::SQRT_2;
    let shrink = ends[1].length() / surface.length().max(f64::MIN_POSITIVE);
    let margin = DVec3::splat(MARGIN + half_pixel * shrink.min(1.0));
    let low = ends[0].min(ends[1]).min(ends[2]) - margin;
    let high = ends[0].max(ends[1]).max(ends[2]) + margin;
    if !(low.abs().max_element() < MAX_COORDINATE && high.abs().max_element() < MAX_COORDINATE) {
        return None;
    }
    let block = |p: DVec3| p.as_ivec3().div_euclid(IVec3::splat(BLOCK));
    Some((block(low.floor()), block(high.ceil())))
}

/// How far the interpolated surface leaves the pixel's own depth inside the pixel, voxels.
fn half_rise(observer: &Observer<'_>, x: usize, y: usize, depth: f64) -> f64 {
    let largest = |rises: [Option<f32>; 2]| {
        let away = |rise: f32| (depth / (1.0 + f64::from(rise) * depth) - depth).abs();
        rises.into_iter().flatten().map(away).fold(0.0, f64::max)
    };
    let [across, down] = observer.rises(x, y).map(largest);
    0.5 * (across + down)
}
