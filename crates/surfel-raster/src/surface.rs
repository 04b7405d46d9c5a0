//! The surface that a pixel sees: the mean of all hits near the median one, whatever their order.
//!
//! Surfels of neighbouring pixels and of several views lie over each other, each a little off the true surface.
//! Blending meets the nearest of them first, so median and expected depth lie before the surface by about the noise;
//! a mean that gives every hit of the layer its own opacity as weight does not, and averages the noise. Beside
//! [`crate::forward`], for whoever measures or fuses depth; not differentiated. Invariant: swapping the order of two
//! layers closer than the reach changes nothing, and hits beyond it have no say.

use crate::Tape;
use crate::blend::{BlendConfig, Lanes, evaluate_row, rows_of};
use crate::forward::depth_order;
use crate::splat::Splat;
use crate::tile::{TILE, TileLists};
use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use surfel_core::Grid;

/// Depth and orientation of the layer of surfels around the median depth.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// z-depth, scene units; 0 where there is none to look around.
    pub depth: Grid<f32>,
    /// Unit normals, camera frame, facing the camera; zero where there is no depth, or where they cancel.
    pub normal: Grid<[f32; 3]>,
}

/// The surface in the rendering that left `tape`. Hits whose inverse depth differs from that of `around` (z-depth, 0 =
/// nothing to look for; usually the median depth) by at most `reach` (1 / scene unit) belong to it. Depth is the mean
/// of their inverse depths, or that of `around` where no hit is within reach.
///
/// # Panics
/// When `around` has not the size of the rendering.
pub fn surface(tape: &Tape, around: &Grid<f32>, reach: f64) -> Surface {
    let Tape { camera, config, splats, grid, .. } = tape;
    assert_eq!((around.width(), around.height()), (camera.width, camera.height), "the size of the rendering");
    let lists = TileLists::new(*grid, splats, &depth_order(splats));
    let config = BlendConfig::new(config);
    let arch = pulp::Arch::new();
    let tiles: Vec<Vec<Layer>> = (0..grid.len())
        .into_par_iter()
        .map(|index| {
            let (corner, surfels) = (grid.corner(index), lists.surfels(index, splats));
            arch.dispatch(LayerTile { corner, around, surfels, splats, config: &config, reach: reach as f32 })
        })
        .collect();
    let at = |x: usize, y: usize| (&tiles[y / TILE * grid.columns + x / TILE][y % TILE], x % TILE);
    Surface {
        depth: Grid::from_fn(camera.width, camera.height, |x, y| {
            let (layer, lane) = at(x, y);
            if layer.inverse_z[lane] > 0.0 { layer.weight[lane] / layer.inverse_z[lane] } else { around[(x, y)] }
        }),
        normal: Grid::from_fn(camera.width, camera.height, |x, y| {
            let (layer, lane) = at(x, y);
            let sum = glam::DVec3::from_array(layer.normal.map(|channel| f64::from(channel[lane])));
            sum.normalize_or_zero().as_vec3().to_array()
        }),
    }
}

/// Sums over the hits of one row of pixels.
#[derive(Clone, Copy)]
struct Layer {
    /// Inverse depth of `around`; infinite where there is none, so that no hit is near it.
    middle: Lanes,
    weight: Lanes,
    inverse_z: Lanes,
    normal: [Lanes; 3],
}

struct LayerTile<'a, R> {
    corner: (usize, usize),
    around: &'a Grid<f32>,
    surfels: R,
    splats: &'a [Splat],
    config: &'a BlendConfig,
    reach: f32,
}

impl<R: Iterator<Item = u32>> WithSimd for LayerTile<'_, R> {
    type Output = Vec<Layer>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Vec<Layer> {
        let Self { corner, around, surfels, splats, config, reach } = self;
        let num_rows = TILE.min(around.height() - corner.1);
        let empty = |row: usize| Layer {
            middle: std::array::from_fn(|lane| match corner.0 + lane < around.width() {
                true if around[(corner.0 + lane, corner.1 + row)] > 0.0 => {
                    1.0 / around[(corner.0 + lane, corner.1 + row)]
                }
                _ => f32::INFINITY,
            }),
            weight: [0.0; TILE],
            inverse_z: [0.0; TILE],
            normal: [[0.0; TILE]; 3],
        };
        let mut layers: Vec<Layer> = (0..num_rows).map(empty).collect();
        for surfel in surfels {
            let splat = &splats[surfel as usize];
            for row in rows_of(splat, corner, num_rows) {
                let sight = evaluate_row(splat, corner.0, corner.1 + row, config);
                if !sight.any {
                    continue;
                }
                let layer = &mut layers[row];
                let mut weight = [0.0f32; TILE];
                for lane in 0..TILE {
                    let is_near = (sight.inverse_z[lane] - layer.middle[lane]).abs() <= reach;
                    weight[lane] = if is_near { sight.alpha[lane] } else { 0.0 };
                }
                for lane in 0..TILE {
                    layer.weight[lane] += weight[lane];
                    layer.inverse_z[lane] += weight[lane] * sight.inverse_z[lane];
                }
                for channel in 0..3 {
                    for lane in 0..TILE {
                        layer.normal[channel][lane] += weight[lane] * splat.normal[channel];
                    }
                }
            }
        }
        layers
    }
}
