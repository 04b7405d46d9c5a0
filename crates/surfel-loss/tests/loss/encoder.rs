//! The terms on the encoder's maps: answers known in closed form, and gradients.

use crate::differences::{beside, check};
use crate::known::{assert_is, picture, value};
use burn::tensor::{Device, Tensor, TensorData};
use surfel_loss::*;

/// A map of one view, `[1, 8, 10]`.
fn map(pixel: impl Fn(usize, usize) -> f32) -> Tensor<3> {
    let values: Vec<f32> = (0..8 * 10).map(|i| pixel(i % 10, i / 10)).collect();
    Tensor::from_data(TensorData::new(values, [1, 8, 10]), &Device::flex())
}

/// A wave that is never 0 and has no kink within 0.1 of it.
fn error() -> Tensor<3> {
    map(|x, y| (0.4 + 0.2 * (1.3 * x as f32 + 2.1 * y as f32).sin()) * if x % 2 == 0 { 1.0 } else { -1.0 })
}

/// One proposal's worth of `[views, proposals, rows, columns]` per list.
fn blocks<const N: usize>(proposals: [[f32; N]; 3]) -> Tensor<4> {
    let values = proposals.as_flattened().to_vec();
    Tensor::from_data(TensorData::new(values, [1, 3, 1, N]), &Device::flex())
}

fn counts<const N: usize>(counts: [f32; N]) -> Tensor<4> {
    Tensor::from_data(TensorData::new(counts.to_vec(), [1, 1, 1, N]), &Device::flex())
}

#[test]
fn depth_in_steps_is_robust_and_weighted() {
    let cost = |error: f64| 0.25 * (1.0 + error / 0.25).ln() + 0.1 * error;
    assert_is(depth_in_steps(map(|_, _| -0.5), map(|_, _| 1.0)), cost(0.5));
    assert_is(depth_in_steps(map(|_, _| 400.0), map(|_, _| 1.0)), cost(16.0));
    // Half of the pixels count three times, a quarter not at all.
    let (errors, weights) = (map(|x, _| [1.0, 0.0, 2.0, 0.0][x % 4]), map(|x, _| [1.0, 3.0, 0.0, 3.0][x % 4]));
    let errors = errors.narrow(2, 0, 8);
    assert_is(depth_in_steps(errors, weights.narrow(2, 0, 8)), cost(1.0) / 7.0);
    assert_eq!(value(depth_in_steps(map(|_, _| 1.0), map(|_, _| 0.0))), 0.0);
    check(error(), 1e-2, |e| depth_in_steps(e.clone(), beside(&e, map(|x, _| (x % 3) as f32))));
}

#[test]
fn a_shift_and_an_edge_cost_no_slope_and_roughness_its_size() {
    let cost = |predicted, truth| slope(predicted, truth, map(|_, _| 1.0));
    let ramp = |x: usize, y: usize| 0.3 * x as f32 - 0.1 * y as f32;
    assert_is(cost(map(|x, y| ramp(x, y) + 5.0), map(ramp)), 0.0);
    let edge = |at: usize| map(move |x, _| if x < at { 0.0 } else { 8.0 });
    assert_is(cost(edge(5), edge(5)), 0.0);
    let rough = |x: usize, y: usize| ramp(x, y) + if (x + y).is_multiple_of(2) { 0.05 } else { -0.05 };
    assert_is(cost(map(rough), map(ramp)), 0.1);
    check(error(), 1e-2, |p| slope(p.clone(), beside(&p, map(ramp)), beside(&p, map(|x, _| (x % 2) as f32 + 1.0))));
}

#[test]
fn pixels_that_do_not_count_have_no_slope() {
    let truth = map(|x, _| 0.2 * x as f32);
    let predicted = map(|x, y| 0.2 * x as f32 + if y == 2 { 0.7 } else { 0.0 });
    assert_is(slope(predicted, truth, map(|_, y| if y == 2 { 0.0 } else { 1.0 })), 0.0);
}

#[test]
fn chords_are_distances_of_the_true_normals() {
    let normals = |rows: [[f32; 3]; 3]| Tensor::<2>::from_data(TensorData::from(rows), &Device::flex());
    let (found, truth) = (
        normals([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 0.6, -0.8]]),
        normals([[0.0, 0.0, -1.0], [0.0, 0.0, -1.0], [0.0; 3]]),
    );
    let counts = Tensor::<1>::from_floats([1.0, 1.0, 0.0], &Device::flex());
    assert_is(chord(found, truth, counts), (1e-4f64.sqrt() + (2.0 + 1e-4f64).sqrt()) / 2.0);
    let rows = |phase: f64| picture(6, 5, phase).reshape([30, 3]);
    let counts = || Tensor::<1>::ones([30], &Device::flex());
    check(rows(0.3), 1e-3, |n| chord(n.clone(), beside(&n, rows(2.0)), beside(&n, counts())));
}

#[test]
fn opacity_is_the_probability_of_being_right_where_that_is_known() {
    let opacity = || map(|x, _| [0.9, 0.2, 0.3, 0.99][x % 4]).narrow(2, 0, 8);
    // Right; off by 2 %; without a surface; and nobody knows.
    let error = || map(|x, _| [0.005, 0.02, 0.0, 0.0][x % 4]).narrow(2, 0, 8);
    let surface = || map(|x, _| [1.0, 1.0, 0.0, 0.0][x % 4]).narrow(2, 0, 8);
    let known = || map(|x, _| [1.0, 1.0, 1.0, 0.0][x % 4]).narrow(2, 0, 8);
    let of_known = -(0.9f64.ln() + 0.8f64.ln() + 0.7f64.ln());
    assert_is(calibrated_opacity(opacity(), error(), surface(), Some(known())), of_known / 3.0);
    assert_is(calibrated_opacity(opacity(), error(), surface(), None), (of_known - 0.01f64.ln()) / 4.0);
    check(opacity(), 1e-3, |o| {
        calibrated_opacity(o.clone(), beside(&o, error()), beside(&o, surface()), Some(beside(&o, known())))
    });
}

#[test]
fn the_best_proposal_is_to_be_believed_and_hopeless_blocks_say_nothing() {
    let errors = || blocks([[0.0, 9.0], [-0.1, 5.0], [0.3, 2.0]]);
    let target = errors().abs() / -0.1;
    assert_is(choice(target, errors(), counts([1.0, 1.0])), 0.0);
    // An even belief in the first block; nothing is right in the second.
    let odds = [1.0, (-1.0f64).exp(), (-3.0f64).exp()];
    let total: f64 = odds.iter().sum();
    let divergence: f64 = odds.iter().map(|odd| odd / total * (3.0 * odd / total).ln()).sum();
    assert_is(choice(errors() * 0.0, errors(), counts([1.0, 1.0])), divergence);
    assert_eq!(value(choice(errors() * 0.0, errors(), counts([0.0, 1.0]))), 0.0);
    let scores = blocks([[0.3, 0.1], [-0.2, 0.9], [0.5, -0.4]]);
    check(scores, 1e-2, |s| choice(s.clone(), beside(&s, errors()), beside(&s, counts([1.0, 1.0]))));
}
