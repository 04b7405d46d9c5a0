//! Convolution as the product of its weights and a matrix of all windows of the map.
//!
//! Twin of `ops/conv`. The gradients of burn's own convolutions are slow on cards unless it tries out dozens of kernels
//! for each size, for minutes; products are fast as they are. Invariant: windows are made again for the pass back, since
//! those of all layers together would fill a card.

use super::{Card, OnCard, values};
use crate::ops::conv::Conv;
use burn::backend::ops::FloatTensorOps;
use burn_cubecl::CubeBackend;
use burn_cubecl::cubecl;
use burn_cubecl::cubecl::prelude::*;

/// As `ops::conv::forward`, but that matrix units round factors to eleven bits.
pub(in crate::ops) fn conv(map: &OnCard, weight: &OnCard, bias: &OnCard, conv: &Conv) -> OnCard {
    let (rows, columns) = conv.output_size();
    let product = CubeBackend::float_matmul(weights(weight, conv), windows(map, conv));
    let sums = shaped(product, &[conv.images, conv.outputs, rows, columns]);
    CubeBackend::float_add(sums, shaped(bias.clone(), &[1, conv.outputs, 1, 1]))
}

/// Gradients of the map, the weights and the bias; those that are not wanted are not computed.
pub(in crate::ops) fn conv_gradients(
    map: &OnCard,
    weight: &OnCard,
    grad: &OnCard,
    wanted: [bool; 3],
    conv: &Conv,
) -> [Option<OnCard>; 3] {
    let (rows, columns) = conv.output_size();
    let Conv { inputs, outputs, kernel, .. } = *conv;
    let grad = || shaped(grad.clone(), &[conv.images, outputs, rows * columns]);
    let turned = |matrix: OnCard| CubeBackend::float_swap_dims(matrix, 1, 2);
    let of_map = || fold(&CubeBackend::float_matmul(turned(weights(weight, conv)), grad()), conv);
    let of_weight = || {
        let of_images = CubeBackend::float_matmul(grad(), turned(windows(map, conv)));
        shaped(CubeBackend::float_sum_dim(of_images, 0), &[outputs, inputs, kernel, kernel])
    };
    let of_bias = || shaped(CubeBackend::float_sum_dims(grad(), &[0, 2]), &[outputs]);
    [wanted[0].then(of_map), wanted[1].then(of_weight), wanted[2].then(of_bias)]
}

fn shaped(tensor: OnCard, shape: &[usize]) -> OnCard {
    CubeBackend::float_reshape(tensor, shape.into())
}

/// `[1, outputs, taps]`.
fn weights(weight: &OnCard, conv: &Conv) -> OnCard {
    shaped(weight.clone(), &[1, conv.outputs, conv.taps()])
}

/// Windows `[images, taps, rows * columns]` of a map `[images, inputs, height, width]`.
fn windows(map: &OnCard, conv: &Conv) -> OnCard {
    let (rows, columns) = conv.output_size();
    let shape = [conv.images, conv.taps(), rows * columns];
    if conv.kernel == 1 && conv.stride == 1 {
        return shaped(map.clone(), &shape);
    }
    let card = Card::of(map);
    let windows = card.empty(&shape);
    let (cubes, units) = card.units(shape.iter().product());
    unfold_kernel::launch(&card.client, cubes, units, values(map), values(&windows), places(conv));
    windows
}

/// The gradient of the map from that of its windows.
fn fold(windows: &OnCard, conv: &Conv) -> OnCard {
    let shape = [conv.images, conv.inputs, conv.height, conv.width];
    if conv.kernel == 1 && conv.stride == 1 {
        return shaped(windows.clone(), &shape);
    }
    let card = Card::of(windows);
    let map = card.empty(&shape);
    let (cubes, units) = card.units(shape.iter().product());
    fold_kernel::launch(&card.client, cubes, units, values(windows), values(&map), places(conv));
    map
}

/// Where windows lie in a map, for a kernel.
#[derive(CubeType, CubeLaunch)]
struct Places {
    height: u32,
    width: u32,
    rows: u32,
    columns: u32,
    stride: u32,
    padding: u32,
    #[cube(comptime)]
    kernel: u32,
}

fn places(conv: &Conv) -> PlacesLaunch {
    let (rows, columns) = conv.output_size();
    let [height, width, rows, columns] = [conv.height, conv.width, rows, columns].map(|size| size as u32);
    PlacesLaunch::new(height, width, rows, columns, conv.stride as u32, conv.padding as u32, conv.kernel as u32)
}

/// One unit per value of a window.
#[cube(launch)]
fn unfold_kernel(map: &[f32], windows: &mut [f32], places: Places) {
    let i = ABSOLUTE_POS;
    if i >= windows.len() {
        terminate!();
    }
    let Places { height, width, rows, columns, stride, padding, kernel } = places;
    let pixel = i as u32 % (rows * columns);
    let value = i as u32 / (rows * columns);
    let (tap, channel) = (value % (kernel * kernel), value / (kernel * kernel));
    // Counted from the border around the map, so that nothing falls below zero.
    let y = pixel / columns * stride + tap / kernel;
    let x = pixel % columns * stride + tap % kernel;
    let inside = y >= padding && x >= padding && y < height + padding && x < width + padding;
    let mut found = 0.0f32;
    if inside {
        found = map[((channel * height + y - padding) * width + x - padding) as usize];
    }
    windows[i] = found;
}

/// One unit per pixel and channel: the windows it is in.
#[cube(launch)]
fn fold_kernel(windows: &[f32], map: &mut [f32], places: Places) {
    let i = ABSOLUTE_POS;
    if i >= map.len() {
        terminate!();
    }
    let Places { height, width, rows, columns, stride, padding, kernel } = places;
    let x = i as u32 % width + padding;
    let y = i as u32 / width % height + padding;
    let channel = i as u32 / (width * height);
    let mut sum = 0.0f32;
    for tap in 0..kernel * kernel {
        let (down, right) = (tap / kernel, tap % kernel);
        if y >= down && x >= right {
            let (row, column) = ((y - down) / stride, (x - right) / stride);
            if row * stride + down == y && column * stride + right == x && row < rows && column < columns {
                sum += windows[(((channel * kernel * kernel + tap) * rows + row) * columns + column) as usize];
            }
        }
    }
    map[i] = sum;
}
