//! What a keypoint looks like: 4 x 4 x 8 histograms of gradient directions (SIFT, Lowe 2004, section 6).
//!
//! The neighbourhood is resampled to an upright 18 x 18 patch at the keypoint's scale and direction,
//! so a picture turned by any angle gives the same numbers. The invariant: every descriptor has unit
//! length, and the dot product of two is the Hellinger kernel of their histograms ("RootSIFT",
//! Arandjelović and Zisserman 2012).

use crate::keypoints::{Keypoint, nearest_level};
use crate::pyramid::Octave;
use rayon::prelude::*;
use std::f32::consts::TAU;

/// Numbers per descriptor.
pub const LENGTH: usize = SPATIAL_BINS * SPATIAL_BINS * DIRECTION_BINS;
const SPATIAL_BINS: usize = 4;
const DIRECTION_BINS: usize = 8;
/// Gradient samples per side; the patch is two larger because gradients are central differences.
const SAMPLES: usize = 16;
/// Width of a spatial bin in units of the keypoint's blur (Lowe 2004, section 6.1).
const BIN_WIDTH_IN_SIGMAS: f64 = 3.0;
/// Cap on one entry before the last normalisation, against glints (Lowe 2004, section 6.1).
const MAX_ENTRY: f32 = 0.2;

/// Descriptors of many keypoints, `[num_keypoints, LENGTH]` row-major.
pub fn describe(keypoints: &[Keypoint], octaves: &[Octave]) -> Vec<f32> {
    let mut rows = vec![0.0f32; keypoints.len() * LENGTH];
    rows.par_chunks_mut(LENGTH)
        .zip(keypoints)
        .for_each(|(row, keypoint)| fill_descriptor(row, &upright_patch(keypoint, &octaves[keypoint.octave])));
    rows
}

const PATCH: usize = SAMPLES + 2;

fn upright_patch(keypoint: &Keypoint, octave: &Octave) -> [[f32; PATCH]; PATCH] {
    let level = &octave.levels[nearest_level(keypoint)];
    let spacing = BIN_WIDTH_IN_SIGMAS * Octave::sigma(keypoint.level) * SPATIAL_BINS as f64 / SAMPLES as f64;
    let (sin, cos) = (keypoint.angle as f64).sin_cos();
    let middle = 0.5 * (PATCH as f64 - 1.0);
    let (right, bottom) = (level.width() as f64 - 1.0, level.height() as f64 - 1.0);
    let mut patch = [[0.0; PATCH]; PATCH];
    for (v, row) in patch.iter_mut().enumerate() {
        for (u, value) in row.iter_mut().enumerate() {
            let (du, dv) = ((u as f64 - middle) * spacing, (v as f64 - middle) * spacing);
            let x = (keypoint.index.x + cos * du - sin * dv).clamp(0.0, right);
            let y = (keypoint.index.y + sin * du + cos * dv).clamp(0.0, bottom);
            *value = level.bilinear(x, y).unwrap_or(0.0);
        }
    }
    patch
}

fn fill_descriptor(histogram: &mut [f32], patch: &[[f32; PATCH]; PATCH]) {
    let middle = 0.5 * (SAMPLES as f32 - 1.0);
    let samples_per_bin = (SAMPLES / SPATIAL_BINS) as f32;
    for v in 0..SAMPLES {
        for u in 0..SAMPLES {
            let dx = patch[v + 1][u + 2] - patch[v + 1][u];
            let dy = patch[v + 2][u + 1] - patch[v][u + 1];
            let (du, dv) = (u as f32 - middle, v as f32 - middle);
            // Half the window as sigma (Lowe 2004, section 6.1).
            let weight = (-(du * du + dv * dv) / (2.0 * (0.5 * SAMPLES as f32).powi(2))).exp();
            let turn = (dy.atan2(dx) / TAU).rem_euclid(1.0) * DIRECTION_BINS as f32;
            let place = |d: f32| d / samples_per_bin + 0.5 * (SPATIAL_BINS as f32 - 1.0);
            deposit(histogram, place(du), place(dv), turn, weight * dx.hypot(dy));
        }
    }
    normalise(histogram);
}

/// Shares a gradient among the two nearest bins along each of the three axes.
fn deposit(histogram: &mut [f32], u: f32, v: f32, turn: f32, magnitude: f32) {
    let (u0, v0, t0) = (u.floor(), v.floor(), turn.floor());
    let (fu, fv, ft) = (u - u0, v - v0, turn - t0);
    for (row, in_row) in [(v0, 1.0 - fv), (v0 + 1.0, fv)] {
        for (column, in_column) in [(u0, 1.0 - fu), (u0 + 1.0, fu)] {
            let inside = 0.0..SPATIAL_BINS as f32;
            if !inside.contains(&row) || !inside.contains(&column) {
                continue;
            }
            let cell = (row as usize * SPATIAL_BINS + column as usize) * DIRECTION_BINS;
            let share = magnitude * in_row * in_column;
            histogram[cell + t0 as usize % DIRECTION_BINS] += share * (1.0 - ft);
            histogram[cell + (t0 as usize + 1) % DIRECTION_BINS] += share * ft;
        }
    }
}

fn normalise(histogram: &mut [f32]) {
    let length = histogram.iter().map(|v| v * v).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
    histogram.iter_mut().for_each(|v| *v = (*v / length).min(MAX_ENTRY));
    let sum = histogram.iter().sum::<f32>().max(f32::MIN_POSITIVE);
    histogram.iter_mut().for_each(|v| *v = (*v / sum).sqrt());
}
