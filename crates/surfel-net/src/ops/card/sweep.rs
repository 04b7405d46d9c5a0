//! Plane-sweep correlation: how alike a pixel is to where it lands in its neighbours at every candidate.
//!
//! Twin of `ops/plane_sweep.rs`, which says what is computed; the pass back scatters, and is left to the CPU. Invariant:
//! a sample outside the neighbour's map, or behind its camera, contributes zero.

use super::{Card, OnCard, values};
use crate::ops::plane_sweep::{MIN_DEPTH_RATIO, Sweep, normaliser};
use burn_cubecl::cubecl;
use burn_cubecl::cubecl::prelude::*;

/// Numbers of a warp: rotation, translation, the neighbour, and what its products are multiplied with.
const WARP: usize = 14;

/// Correlations `[views, height, candidates, width]` of features `[views, height, width, channels]`.
pub(in crate::ops) fn sweep(features: &OnCard, channels: usize, sweep: &Sweep) -> OnCard {
    let card = Card::of(features);
    let (views, candidates) = (sweep.num_views(), sweep.num_candidates());
    let volume = card.empty(&[views, sweep.height, candidates, sweep.width]);
    let mut warps = Vec::new();
    let mut first = vec![0i32];
    for of_view in &sweep.warps {
        for warp in of_view {
            warps.extend(warp.rotation.as_flattened().iter().chain(&warp.translation));
            warps.extend([warp.other as f32, normaliser(channels, of_view.len())]);
        }
        first.push((warps.len() / WARP) as i32);
    }
    let (cubes, units) = card.units(views * candidates * sweep.height * sweep.width);
    sweep_kernel::launch(
        &card.client,
        cubes,
        units,
        values(features),
        card.floats(warps),
        card.integers(first),
        card.floats(sweep.all_disparities()),
        values(&volume),
        sweep.height as u32,
        candidates as u32,
        sweep.width as u32,
        channels as u32,
    );
    volume
}

/// One unit per pixel and candidate.
#[cube(launch)]
fn sweep_kernel(
    features: &[f32],
    warps: &[f32],
    first: &[i32],
    disparities: &[f32],
    volume: &mut [f32],
    height: u32,
    candidates: u32,
    width: u32,
    channels: u32,
) {
    let i = ABSOLUTE_POS;
    if i >= volume.len() {
        terminate!();
    }
    let column = i as u32 % width;
    let candidate = i as u32 / width % candidates;
    let row = i as u32 / (width * candidates) % height;
    let view = i as u32 / (width * candidates * height);
    let (x, y) = (f32::cast_from(column), f32::cast_from(row));
    let own = ((view * height + row) * width + column) * channels;
    let disparity = disparities[(((view * candidates + candidate) * height + row) * width + column) as usize];
    let mut value = 0.0f32;
    for warp in first[view as usize]..first[view as usize + 1] {
        let at = warp as usize * WARP;
        let u = warps[at] * x + warps[at + 1] * y + warps[at + 2] + disparity * warps[at + 9];
        let v = warps[at + 3] * x + warps[at + 4] * y + warps[at + 5] + disparity * warps[at + 10];
        let z = warps[at + 6] * x + warps[at + 7] * y + warps[at + 8] + disparity * warps[at + 11];
        if z > MIN_DEPTH_RATIO {
            let (u, v) = (u / z, v / z);
            if u > -1.0f32 && v > -1.0f32 && u < f32::cast_from(width) && v < f32::cast_from(height) {
                let (left, top) = (f32::floor(u), f32::floor(v));
                let (fx, fy) = (u - left, v - top);
                let other = u32::cast_from(warps[at + 12]) * height;
                let mut sum = 0.0f32;
                #[unroll]
                for corner in 0..4u32 {
                    let (right, below) = (comptime!(corner % 2), comptime!(corner / 2));
                    let (cx, cy) = (left as i32 + right as i32, top as i32 + below as i32);
                    if cx >= 0 && cy >= 0 && cx < width as i32 && cy < height as i32 {
                        let theirs = ((other + cy as u32) * width + cx as u32) * channels;
                        let mut product = 0.0f32;
                        for c in 0..channels {
                            product += features[(own + c) as usize] * features[(theirs + c) as usize];
                        }
                        let of_x = if comptime!(right == 1) { fx } else { 1.0f32 - fx };
                        let of_y = if comptime!(below == 1) { fy } else { 1.0f32 - fy };
                        sum += product * of_x * of_y;
                    }
                }
                value += warps[at + 13] * sum;
            }
        }
    }
    volume[i] = value;
}
