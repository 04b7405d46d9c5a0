//! What a device is asked: one question per kind of operator, and the shipped network as a whole.
//!
//! Sizes follow from those of a pair of photographs. Invariant: a question is a function of its sizes alone.

use crate::cost_volume::{DepthRange, sweep, uniform_candidates, warps};
use crate::example_scene::{ExampleScene, cameras};
use crate::head::SurfelTensors;
use crate::layers::{nearest, upsample, values};
use crate::model::SurfelNet;
use crate::ops::gather_attention::{Regions, Window};
use crate::ops::plane_sweep::Base;
use crate::ops::propagate::Proposals;
use crate::ops::{self, Activation};
use burn::module::Module;
use burn::nn::GroupNormConfig;
use burn::tensor::module::linear;
use burn::tensor::{Device, Tensor, TensorData};
use std::sync::Arc;

/// Channels of the maps and tokens.
const CHANNELS: usize = 64;
const HEADS: usize = 4;
/// Single precision, sums in another order.
const ROUNDING: f64 = 1e-4;
/// Products of matrices, whose factors a card's matrix units round to eleven bits (TF32).
const MATRIX_UNITS: f64 = 2e-3;
/// The same where gradients are what is left of means that nearly cancel.
const CANCELLATION: f64 = 1e-3;
/// The same through a whole network.
const DEEP_ROUNDING: f64 = 1e-2;

/// A question, and how far apart two right answers may be.
pub(super) struct Case {
    pub(super) name: &'static str,
    pub(super) tolerance: f64,
    /// Arrays, each compared by itself.
    pub(super) compute: Box<dyn Fn(&Device) -> Vec<Vec<f32>>>,
}

/// The questions for two photographs of this size, which must be divisible by 16.
pub(super) fn cases(width: usize, height: usize) -> Vec<Case> {
    vec![
        convolution("convolution, 3 x 3", 1, (width / 2, height / 2)),
        convolution("its every other pixel", 2, (width / 2, height / 2)),
        normalisation(width / 2, height / 2),
        upsampling(width / 4, height / 4),
        feed_forward(width * height / 16),
        self_attention(width * height / 64),
        plane_sweep(width / 4, height / 4),
        gather_attention(width / 4, height / 4),
        propagation(width, height),
        rendering(width, height),
        shipped_network(width, height),
        shipped_network_taught(width, height),
    ]
}

/// Numbers in \[-1, 1) that look random and are the same everywhere.
fn numbers(count: usize, which: usize) -> Vec<f32> {
    let hash = |i: usize| (i + 1 + 7919 * which).wrapping_mul(0x9e37_79b9_7f4a_7c15_u64 as usize) >> 40;
    (0..count).map(|i| hash(i) as f32 / (1 << 23) as f32 - 1.0).collect()
}

/// The output of `function` of inputs with these many values, and the gradient of each input.
fn differentiated(
    name: &'static str,
    counts: Vec<usize>,
    function: impl Fn(&[Tensor<1>]) -> Tensor<1> + 'static,
) -> Case {
    let compute = move |device: &Device| {
        let tensor = |(which, count): (usize, &usize)| {
            let data = TensorData::new(numbers(*count, which), [*count]);
            Tensor::<1>::from_data(data, &device.clone().autodiff()).require_grad()
        };
        let inputs: Vec<Tensor<1>> = counts.iter().enumerate().map(tensor).collect();
        let output = function(&inputs);
        let [count] = output.dims();
        let weights = Tensor::from_data(TensorData::new(numbers(count, counts.len()), [count]), &output.device());
        let gradients = (output.clone() * weights).sum().backward();
        let of_inputs = inputs.iter().filter_map(|input| input.grad(&gradients)).map(values);
        std::iter::once(values(output)).chain(of_inputs).collect()
    };
    Case { name, tolerance: ROUNDING, compute: Box::new(compute) }
}

fn convolution(name: &'static str, stride: usize, (width, height): (usize, usize)) -> Case {
    let counts = vec![2 * CHANNELS * height * width, CHANNELS * CHANNELS * 9, CHANNELS];
    let case = differentiated(name, counts, move |inputs| {
        let [x, weight, bias] = [0, 1, 2].map(|i| inputs[i].clone());
        let (x, weight) = (x.reshape([2, CHANNELS, height, width]), weight.reshape([CHANNELS, CHANNELS, 3, 3]));
        ops::conv2d(x, weight, Some(bias), stride, 1).flatten(0, 3)
    });
    Case { tolerance: MATRIX_UNITS, ..case }
}

fn normalisation(width: usize, height: usize) -> Case {
    let case = differentiated("group norm, GELU", vec![2 * CHANNELS * height * width], move |inputs| {
        let x = inputs[0].clone().reshape([2, CHANNELS, height, width]);
        let norm = GroupNormConfig::new(8, CHANNELS).init(&x.device());
        ops::group_norm(&norm, x, Activation::Gelu, None).flatten(0, 3)
    });
    Case { tolerance: CANCELLATION, ..case }
}

fn upsampling(width: usize, height: usize) -> Case {
    differentiated("upsampling", vec![2 * CHANNELS * height * width], move |inputs| {
        let x = inputs[0].clone().reshape([2, CHANNELS, height, width]);
        upsample(nearest(x, 2), 2, 0).flatten(0, 3)
    })
}

fn feed_forward(tokens: usize) -> Case {
    let counts = vec![tokens * CHANNELS, CHANNELS * 4 * CHANNELS];
    let case = differentiated("linear", counts, move |inputs| {
        let x = inputs[0].clone().reshape([tokens, CHANNELS]);
        linear(x, inputs[1].clone().reshape([CHANNELS, 4 * CHANNELS]), None).flatten(0, 1)
    });
    Case { tolerance: MATRIX_UNITS, ..case }
}

fn self_attention(tokens: usize) -> Case {
    let dim = CHANNELS / HEADS;
    let case = differentiated("attention", vec![2 * CHANNELS * tokens; 3], move |inputs| {
        let [q, k, v] = [0, 1, 2].map(|i| inputs[i].clone().reshape([2, HEADS, tokens, dim]));
        ops::attention(q, k, v, None).flatten(0, 3)
    });
    Case { tolerance: MATRIX_UNITS, ..case }
}

fn plane_sweep(width: usize, height: usize) -> Case {
    let ranges = [DepthRange { near: 1.0, far: 5.0 }; 2];
    let warps = warps(&cameras(4 * width, 4 * height), &[vec![1], vec![0]], 4);
    let disparities = ranges.iter().map(|range| uniform_candidates(range, 64)).collect();
    let geometry = Arc::new(sweep(warps, (width, height), disparities, Base::Zero));
    differentiated("plane sweep", vec![2 * CHANNELS * height * width], move |inputs| {
        ops::plane_sweep(inputs[0].clone().reshape([2, CHANNELS, height, width]), geometry.clone()).flatten(0, 3)
    })
}

fn gather_attention(width: usize, height: usize) -> Case {
    const SIDE: usize = 4;
    let surfels = 2 * width * height;
    let window = |i: usize| {
        let (x, y) = (i / 2 % width, i / 2 / width % height);
        let first = |at: usize, len: usize| at.min(len - SIDE) as i32;
        Window { x: first(x, width), y: first(y, height), step: 1, mask: (1 << (SIDE * SIDE)) - 1 }
    };
    let windows = (0..2 * surfels).map(window).collect();
    let regions = Arc::new(Regions { width, height, side: SIDE, targets: vec![vec![0, 1], vec![1, 0]], windows });
    differentiated("gather attention", vec![surfels * CHANNELS; 3], move |inputs| {
        let [q, k, v] = [0, 1, 2].map(|i| inputs[i].clone().reshape([surfels, CHANNELS]));
        ops::gather_attention(q, k, v, HEADS, regions.clone()).flatten(0, 1)
    })
}

fn propagation(width: usize, height: usize) -> Case {
    const STRIDE: usize = 4;
    let offsets = vec![[0, 0], [-8, 0], [8, 0], [0, -8], [0, 8]];
    let count = offsets.len();
    // Two uneven surfaces, far enough apart that no pixel finds them equal.
    let uneven = numbers(2 * width * height, 2);
    let plane = |i: usize| [if i % width < width / 2 { uneven[i] } else { 20.0 + uneven[i] }, 0.1 * uneven[i], 0.05];
    let planes = (0..2 * width * height).map(plane).collect();
    let proposals = Arc::new(Proposals { width, height, stride: STRIDE, planes, offsets });
    let scores = 2 * count * (height / STRIDE) * (width / STRIDE);
    differentiated("plane propagation", vec![scores, 2 * width * height], move |inputs| {
        let scores = inputs[0].clone().reshape([2, count, height / STRIDE, width / STRIDE]);
        let leans = inputs[1].clone().reshape([2, 1, height, width]);
        ops::propagate_planes(scores, leans, proposals.clone()).flatten(0, 3)
    })
}

fn rendering(width: usize, height: usize) -> Case {
    let surfels = width * height;
    let camera = cameras(width, height)[0];
    differentiated("rendering", vec![3 * surfels, 2 * surfels, 4 * surfels, surfels, 3 * surfels], move |inputs| {
        let [centres, scales, rotations, opacities, sh] = [0, 1, 2, 3, 4].map(|i| inputs[i].clone());
        let device = centres.device();
        let before_camera = Tensor::<2>::from_data([[0.0, 0.0, 3.0]], &device);
        let upright = Tensor::<2>::from_data([[4.0, 0.0, 0.0, 0.0]], &device);
        let rotations = rotations.reshape([surfels, 4]) + upright;
        let length = rotations.clone().powi_scalar(2).sum_dim(1).sqrt();
        let surfels = SurfelTensors {
            centres: centres.reshape([surfels, 3]) + before_camera,
            scales: scales.reshape([surfels, 2]) * 0.005 + 0.01,
            rotations: rotations / length,
            opacities: opacities * 0.4 + 0.5,
            sh: sh.reshape([surfels, 1, 3]),
            sh_degree: 0,
        };
        let maps = crate::render(&surfels, &camera, &DepthRange { near: 1.0, far: 5.0 }.render_config())
            .expect("these surfels can be rendered");
        Tensor::cat(vec![maps.colour.flatten(0, 2), maps.alpha.flatten(0, 1), maps.depth_expected.flatten(0, 1)], 0)
    })
}

/// The encoder's maps by the weights that ship; without gradients, because a choice between planes that two devices
/// see as equal may fall differently and send the gradient elsewhere.
fn shipped_network(width: usize, height: usize) -> Case {
    let scene = ExampleScene::new(width, height);
    let compute = move |device: &Device| {
        let net = SurfelNet::shipped(&Device::flex()).expect("the shipped weights load").to_device(device);
        let maps = net.forward_maps(&scene.input(true), device).expect("the scene is usable");
        vec![values(maps.depth), values(maps.confidence)]
    };
    Case { name: "shipped network", tolerance: DEEP_ROUNDING, compute: Box::new(compute) }
}

/// A pass back through it: only that the device knows every gradient, for the reason above.
fn shipped_network_taught(width: usize, height: usize) -> Case {
    let scene = ExampleScene::new(width, height);
    let compute = move |device: &Device| {
        let device = &device.clone().autodiff();
        let net = SurfelNet::shipped(&Device::flex().autodiff()).expect("the shipped weights load").fork(device);
        let maps = net.forward_maps(&scene.input(true), device).expect("the scene is usable");
        let loss = maps.depth.mean() + maps.confidence.mean();
        drop(loss.backward());
        vec![values(loss.is_finite().float())]
    };
    Case { name: "its gradients", tolerance: ROUNDING, compute: Box::new(compute) }
}
