//! Plane propagation: which of the surfaces proposed to a pixel it joins, and who is to be believed more.
//!
//! Twin of `ops/propagate.rs`, which says what is computed. One unit answers for a pixel, in the pass back for a block,
//! whose pixels share scores. Invariant: proposals are looked at in their order.

use super::{Card, OnCard, values};
use crate::ops::propagate::{FARTHEST, Proposals, REACH, SOFT_STEPS};
use burn_cubecl::cubecl;
use burn_cubecl::cubecl::prelude::*;

/// What a unit needs of [`Proposals`] to look at a pixel.
#[derive(CubeType)]
struct Place {
    view: u32,
    x: u32,
    y: u32,
    height: u32,
    width: u32,
    #[cube(comptime)]
    stride: u32,
    #[cube(comptime)]
    count: u32,
}

/// Planes `[views, 3, height, width]`, as `ops::propagate::forward` gives them.
pub(in crate::ops) fn propagate(scores: &OnCard, leans: &OnCard, proposals: &Proposals) -> OnCard {
    let card = Card::of(scores);
    let Proposals { width, height, stride, ref planes, ref offsets } = *proposals;
    let chosen = card.empty(&[proposals.num_views(), 3, height, width]);
    let (cubes, units) = card.units(planes.len());
    choose_kernel::launch(
        &card.client,
        cubes,
        units,
        values(scores),
        values(leans),
        card.floats(planes.as_flattened().to_vec()),
        card.integers(offsets.as_flattened().to_vec()),
        values(&chosen),
        planes.len() as u32,
        height as u32,
        width as u32,
        stride as u32,
        offsets.len() as u32,
    );
    chosen
}

/// Gradients of the scores and of the leans, as `ops::propagate::backward` gives them.
pub(in crate::ops) fn propagate_gradients(
    scores: &OnCard,
    leans: &OnCard,
    proposals: &Proposals,
    grad: &OnCard,
) -> [OnCard; 2] {
    let card = Card::of(scores);
    let Proposals { width, height, stride, ref planes, ref offsets } = *proposals;
    let ((columns, rows), views, count) = (proposals.weight_size(), proposals.num_views(), offsets.len());
    let of_scores = card.empty(&[views, count, rows, columns]);
    let of_leans = card.empty(&[views, 1, height, width]);
    let (cubes, units) = card.units(views * rows * columns);
    gradients_kernel::launch(
        &card.client,
        cubes,
        units,
        values(scores),
        values(leans),
        card.floats(planes.as_flattened().to_vec()),
        card.integers(offsets.as_flattened().to_vec()),
        values(grad),
        values(&of_scores),
        values(&of_leans),
        (views * rows * columns) as u32,
        height as u32,
        width as u32,
        stride as u32,
        count as u32,
    );
    [of_scores, of_leans]
}

/// One unit per pixel.
#[cube(launch)]
fn choose_kernel(
    scores: &[f32],
    leans: &[f32],
    planes: &[f32],
    offsets: &[i32],
    chosen: &mut [f32],
    pixels: u32,
    height: u32,
    width: u32,
    #[comptime] stride: u32,
    #[comptime] count: u32,
) {
    let i = ABSOLUTE_POS as u32;
    if i >= pixels {
        terminate!();
    }
    let (x, y, view) = (i % width, i / width % height, i / (width * height));
    let place = Place { view, x, y, height, width, stride, count };
    let mut depths = Array::<f32>::new(comptime!(count as usize));
    let mut shares = Array::<f32>::new(comptime!(count as usize));
    choose(scores, leans, planes, offsets, &place, &mut depths, &mut shares);
    let mut depth = 0.0f32;
    let mut right = 0.0f32;
    let mut down = 0.0f32;
    for k in 0..count {
        let from = proposer(offsets, &place, k) as usize;
        let share = shares[k as usize];
        depth += share * depths[k as usize];
        right += share * planes[3 * from + 1];
        down += share * planes[3 * from + 2];
    }
    let first = (view * 3 * height * width + y * width + x) as usize;
    let map = (height * width) as usize;
    chosen[first] = depth;
    chosen[first + map] = right;
    chosen[first + 2 * map] = down;
}

/// One unit per block.
#[cube(launch)]
fn gradients_kernel(
    scores: &[f32],
    leans: &[f32],
    planes: &[f32],
    offsets: &[i32],
    grad: &[f32],
    of_scores: &mut [f32],
    of_leans: &mut [f32],
    blocks: u32,
    height: u32,
    width: u32,
    #[comptime] stride: u32,
    #[comptime] count: u32,
) {
    let i = ABSOLUTE_POS as u32;
    if i >= blocks {
        terminate!();
    }
    let (rows, columns) = (height / stride, width / stride);
    let (column, row, view) = (i % columns, i / columns % rows, i / (columns * rows));
    let mut depths = Array::<f32>::new(comptime!(count as usize));
    let mut shares = Array::<f32>::new(comptime!(count as usize));
    let mut sums = Array::<f32>::new(comptime!(count as usize));
    for k in 0..count {
        sums[k as usize] = 0.0f32;
    }
    for within in 0..stride * stride {
        let (x, y) = (column * stride + within % stride, row * stride + within / stride);
        let place = Place { view, x, y, height, width, stride, count };
        choose(scores, leans, planes, offsets, &place, &mut depths, &mut shares);
        let mut mean = 0.0f32;
        for k in 0..count {
            let gain = gain(grad, planes, offsets, &place, &depths, k);
            mean += shares[k as usize] * gain;
        }
        let mut of_lean = 0.0f32;
        for k in 0..count {
            let gain = gain(grad, planes, offsets, &place, &depths, k);
            let of_score = shares[k as usize] * (gain - mean);
            of_lean += of_score * soft(depths[k as usize]);
            sums[k as usize] += of_score;
        }
        of_leans[((view * height + y) * width + x) as usize] = of_lean;
    }
    for k in 0..count {
        of_scores[(((view * count + k) * rows + row) * columns + column) as usize] = sums[k as usize];
    }
}

/// What the loss gains by proposal `k` at a pixel, given the gradient of the planes chosen.
#[cube]
fn gain(grad: &[f32], planes: &[f32], offsets: &[i32], place: &Place, depths: &Array<f32>, k: u32) -> f32 {
    let from = 3 * proposer(offsets, place, k) as usize;
    let map = (place.height * place.width) as usize;
    let at = (place.view * 3 * place.height * place.width + place.y * place.width + place.x) as usize;
    grad[at] * depths[k as usize] + grad[at + map] * planes[from + 1] + grad[at + 2 * map] * planes[from + 2]
}

/// Inverse depths proposed to a pixel, relative to its own, and the share of each in the surface with the most weight.
#[cube]
fn choose(
    scores: &[f32],
    leans: &[f32],
    planes: &[f32],
    offsets: &[i32],
    place: &Place,
    depths: &mut Array<f32>,
    shares: &mut Array<f32>,
) {
    let (view, x, y, height, width) = (place.view, place.x, place.y, place.height, place.width);
    let stride = comptime!(place.stride);
    let count = comptime!(place.count);
    let own = planes[3 * ((view * height + y) * width + x) as usize];
    let lean = leans[((view * height + y) * width + x) as usize];
    let (rows, columns) = (height / stride, width / stride);
    let block = y / stride * columns + x / stride;
    let mut largest = f32::min_value();
    for k in 0..count {
        let from = proposer(offsets, place, k);
        let (nx, ny) = (from % width, from / width % height);
        let (dx, dy) = (f32::cast_from(x) - f32::cast_from(nx), f32::cast_from(y) - f32::cast_from(ny));
        let at = 3 * from as usize;
        let depth = planes[at] + planes[at + 1] * dx + planes[at + 2] * dy - own;
        let depth = clamp(depth, -FARTHEST, FARTHEST);
        let score = scores[((view * count + k) * rows * columns + block) as usize] + lean * soft(depth);
        depths[k as usize] = depth;
        shares[k as usize] = score;
        largest = max(largest, score);
    }
    for k in 0..count {
        shares[k as usize] = f32::exp(shares[k as usize] - largest);
    }
    let mut most = f32::min_value();
    let mut middle = 0.0f32;
    for to in 0..count {
        let mut mass = 0.0f32;
        for from in 0..count {
            if f32::abs(depths[from as usize] - depths[to as usize]) <= REACH {
                mass += shares[from as usize];
            }
        }
        if mass > most {
            most = mass;
            middle = depths[to as usize];
        }
    }
    for k in 0..count {
        let mut share = 0.0f32;
        if f32::abs(depths[k as usize] - middle) <= REACH {
            share = shares[k as usize] / most;
        }
        shares[k as usize] = share;
    }
}

/// Index of the pixel, over all views, that makes proposal `k`.
#[cube]
fn proposer(offsets: &[i32], place: &Place, k: u32) -> u32 {
    let nx = within(place.x, offsets[2 * k as usize], place.width);
    let ny = within(place.y, offsets[2 * k as usize + 1], place.height);
    (place.view * place.height + ny) * place.width + nx
}

/// Index `by` away from `at`, or at the border of `len`.
#[cube]
fn within(at: u32, by: i32, len: u32) -> u32 {
    clamp(at as i32 + by, 0i32, len as i32 - 1) as u32
}

/// See `ops::propagate::soft`.
#[cube]
fn soft(steps: f32) -> f32 {
    steps / (SOFT_STEPS + f32::abs(steps))
}
