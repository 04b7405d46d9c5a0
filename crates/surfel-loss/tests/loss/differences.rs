//! Every term's gradient through burn against central differences, in f32 with steps to match.

use crate::known::{INTRINSICS, map, picture, wave};
use burn::tensor::{Device, Tensor, TensorData};
use surfel_loss::*;
use surfel_net::DepthRange;

const RANGE: DepthRange = DepthRange { near: 1.0, far: 4.0 };

/// Checks the gradient of `term` at `start`. Each term is a mean over pixels: relative to the largest gradient,
/// f32 leaves about 1e-3.
pub fn check<const D: usize>(start: Tensor<D>, step: f32, term: impl Fn(Tensor<D>) -> Tensor<1>) {
    let shape = start.dims();
    let values: Vec<f32> = start.into_data().try_into_vec().expect("f32");
    let tensor =
        |values: &[f32], device: &Device| Tensor::<D>::from_data(TensorData::new(values.to_vec(), shape), device);
    let tracked = tensor(&values, &Device::flex().autodiff()).require_grad();
    let grads = term(tracked.clone()).backward();
    let found: Vec<f32> = tracked.grad(&grads).expect("tracked").into_data().try_into_vec().expect("f32");
    let largest = found.iter().fold(0.0f32, |m, g| m.max(g.abs()));
    assert!(largest > 0.0 && largest.is_finite(), "the gradient is {largest} everywhere");
    for i in (0..values.len()).step_by(1 + values.len() / 60) {
        let at = |offset: f32| {
            let mut moved = values.clone();
            moved[i] += offset;
            f64::from(term(tensor(&moved, &Device::flex())).into_scalar::<f32>())
        };
        let difference = ((at(step) - at(-step)) / (2.0 * f64::from(step))) as f32;
        let apart = (found[i] - difference).abs();
        assert!(
            apart < 0.01 * largest + 0.01 * difference.abs(),
            "value {i}: {}, differences say {difference}",
            found[i]
        );
    }
}

fn on<const D: usize>(like: &Tensor<D>, other: Tensor<D>) -> Tensor<D> {
    Tensor::from_data(other.into_data(), &like.device())
}

/// `other` of another rank on the device of `like`.
pub fn beside<const D: usize, const E: usize>(like: &Tensor<D>, other: Tensor<E>) -> Tensor<E> {
    Tensor::from_data(other.into_data(), &like.device())
}

#[test]
fn photometric_gradient() {
    check(picture(9, 7, 0.3), 1e-2, |p| photometric(p.clone(), on(&p, picture(9, 7, 1.0))));
}

#[test]
fn opacity_gradient() {
    let start = Tensor::from_floats([0.1, 0.4, 0.5, 0.93, 0.99], &Device::flex());
    check(start, 1e-2, opacity);
}

#[test]
fn silhouette_gradient() {
    let mask = || map(8, 6, |x, _| f32::from(u8::from(x > 3)));
    check(map(8, 6, |x, y| 0.5 + 0.4 * wave(x, y, 0.0)), 2e-3, |a| silhouette(a.clone(), on(&a, mask())));
}

#[test]
fn depth_gradient() {
    let truth = || map(8, 6, |x, y| if (x + y) % 5 == 0 { 0.0 } else { 2.0 + 0.5 * wave(x, y, 1.0) });
    check(map(8, 6, |x, y| 2.3 + 0.1 * wave(y, x, 0.0)), 1e-2, |d| depth(d.clone(), on(&d, truth()), &RANGE));
}

#[test]
fn normal_gradient() {
    let mask = || map(8, 6, |x, y| f32::from(u8::from((x + 2 * y) % 4 != 0)));
    let unit = || {
        let raw = picture(8, 6, 0.7) - 0.5;
        raw.clone() / raw.square().sum_dim(0).sqrt()
    };
    check(picture(8, 6, 2.0) - 0.4, 2e-3, |n| normal(n.clone(), on(&n, unit()), beside(&n, mask())));
}

#[test]
fn depth_normals_gradient() {
    let weights = || picture(7, 5, 0.2).narrow(1, 0, 5).narrow(2, 0, 7) - 0.5;
    check(map(9, 7, |x, y| 2.0 + 0.3 * wave(x, y, 0.4)), 2e-3, |d| {
        let surface = depth_normals(d.clone(), &INTRINSICS).expect("large enough");
        (surface.normals * beside(&d, weights())).mean()
    });
}

#[test]
fn alignment_gradients_reach_all_three_maps() {
    let alpha = || map(9, 7, |x, y| 0.7 + 0.2 * wave(x, y, 0.1));
    let normals =
        || (picture(9, 7, 1.3) - 0.5) * Tensor::<3>::from_floats([[[0.4]], [[0.4]], [[-1.0]]], &Device::flex());
    let surface = || map(9, 7, |x, y| 2.0 + 0.2 * wave(x, y, 0.4));
    check(alpha(), 1e-2, |a| alignment(a.clone(), beside(&a, normals()), on(&a, surface()), &INTRINSICS));
    check(normals(), 1e-2, |n| alignment(beside(&n, alpha()), n.clone(), beside(&n, surface()), &INTRINSICS));
    check(surface(), 2e-3, |d| alignment(on(&d, alpha()), beside(&d, normals()), d.clone(), &INTRINSICS));
}

#[test]
fn ssim_gradient() {
    check(picture(15, 13, 0.0), 5e-3, |p| -ssim(p.clone(), on(&p, picture(15, 13, 0.8))));
}
