//! Terms whose answers are known in closed form or from elsewhere.

use burn::tensor::{Device, Tensor, TensorData};
use glam::DVec3;
use surfel_core::{Grid, Intrinsics};
use surfel_loss::*;
use surfel_net::DepthRange;
use surfel_raster::derived;

pub const INTRINSICS: Intrinsics = Intrinsics { fx: 31.0, fy: 29.0, cx: 4.5, cy: 3.25 };

/// A map `[height, width]`.
pub fn map(width: usize, height: usize, pixel: impl Fn(usize, usize) -> f32) -> Tensor<2> {
    let values = Grid::from_fn(width, height, pixel).into_vec();
    Tensor::from_data(TensorData::new(values, [height, width]), &Device::flex())
}

/// A vector map `[3, height, width]`.
pub fn vectors(grid: &Grid<[f32; 3]>) -> Tensor<3> {
    let data = TensorData::new(grid.as_slice().as_flattened().to_vec(), [grid.height(), grid.width(), 3]);
    Tensor::<3>::from_data(data, &Device::flex()).permute([2, 0, 1])
}

/// Something between -1 and 1 that repeats nowhere near.
pub fn wave(x: usize, y: usize, phase: f64) -> f32 {
    (1.3 * x as f64 + 2.1 * y as f64 + phase).sin() as f32
}

/// The smooth picture whose SSIM is known.
pub fn picture(width: usize, height: usize, phase: f64) -> Tensor<3> {
    vectors(&Grid::from_fn(width, height, |x, y| {
        let wave = |a: f64, b: f64| (0.5 + 0.4 * (a * x as f64 + b * y as f64 + phase).sin()) as f32;
        [wave(0.3, 0.1), wave(-0.2, 0.5), wave(0.9, 0.4)]
    }))
}

pub fn value(term: Tensor<1>) -> f64 {
    f64::from(term.into_scalar::<f32>())
}

pub fn assert_is(term: Tensor<1>, expected: f64) {
    let found = value(term);
    assert!((found - expected).abs() < 1e-5, "{found} instead of {expected}");
}

#[test]
fn a_tenth_off_everywhere_is_a_hundredth() {
    assert_is(photometric(picture(5, 4, 0.0) + 0.1, picture(5, 4, 0.0)), 0.01);
    assert_eq!(value(photometric(picture(5, 4, 0.0), picture(5, 4, 0.0))), 0.0);
}

#[test]
fn undecided_surfels_cost_a_quarter_and_decided_ones_nothing() {
    assert_is(opacity(Tensor::from_floats([0.0, 1.0, 0.5, 0.5], &Device::flex())), 0.125);
}

#[test]
fn silhouette_is_the_cross_entropy() {
    let (alpha, mask) = (map(2, 1, |x, _| [0.8, 0.3][x]), map(2, 1, |x, _| [1.0, 0.0][x]));
    assert_is(silhouette(alpha, mask), -(0.8f64.ln() + 0.7f64.ln()) / 2.0);
    let worst = value(silhouette(map(2, 1, |_, _| 0.0), map(2, 1, |_, _| 1.0)));
    assert!((worst - 1e4f64.ln()).abs() < 1e-2, "{worst}");
}

#[test]
fn depth_counts_only_pixels_with_truth_in_range_and_a_prediction() {
    let range = DepthRange { near: 1.0, far: 5.0 };
    // Off by a fifth of the range, then: no truth, not a number, too near, too far, no prediction.
    let truth = map(6, 1, |x, _| [2.0, 0.0, f32::NAN, 0.9, 5.1, 2.0][x]);
    let predicted = map(6, 1, |x, _| [2.8, 2.0, 2.0, 2.0, 2.0, 0.0][x]);
    assert_is(depth(predicted.clone(), truth.clone(), &range), 0.9 * 0.2 + 0.1 * 0.04);
    let nowhere = truth * 0.0;
    assert_eq!(value(depth(predicted, nowhere.mask_fill(map(6, 1, |_, _| 1.0).bool(), 0.0), &range)), 0.0);
}

#[test]
fn normals_are_compared_as_directions_where_the_mask_says() {
    let up = Grid::filled(4, 1, [0.0f32, -1.0, 0.0]);
    // The same way but half as long, at a right angle, none rendered, and masked out with rubbish as truth.
    let blended = Grid::from_fn(4, 1, |x, _| [[0.0, -0.5, 0.0], [0.3, 0.0, 0.0], [0.0; 3], [1.0, 0.0, 0.0]][x]);
    let truth = Grid::from_fn(4, 1, |x, y| if x == 3 { [f32::NAN; 3] } else { up[(x, y)] });
    let mask = map(4, 1, |x, _| [1.0, 1.0, 1.0, 0.0][x]);
    assert_is(normal(vectors(&blended), vectors(&truth), mask), (0.0 + 2.0) / 2.0);
}

/// z-depth of the plane `normal . X = -2`.
fn plane(normal: DVec3, width: usize, height: usize) -> Grid<f32> {
    let centre = INTRINSICS.principal_index();
    Grid::from_fn(width, height, |x, y| {
        let ray = DVec3::new((x as f64 - centre.x) / INTRINSICS.fx, (y as f64 - centre.y) / INTRINSICS.fy, 1.0);
        (-2.0 / normal.dot(ray)) as f32
    })
}

fn of_grid(grid: &Grid<f32>) -> Tensor<2> {
    map(grid.width(), grid.height(), |x, y| grid[(x, y)])
}

#[test]
fn depth_normals_are_the_rasterizers_and_so_are_their_gradients() {
    let mut surface = Grid::from_fn(9, 7, |x, y| 2.0 + 0.3 * wave(x, y, 0.4));
    surface[(4, 3)] = 0.0;
    let weights = Grid::from_fn(9, 7, |x, y| [wave(x, y, 0.0), wave(x, y, 1.0), wave(x, y, 2.0)]);
    let tracked = Tensor::<2>::from_data(of_grid(&surface).into_data(), &Device::flex().autodiff()).require_grad();
    let found = depth_normals(tracked.clone(), &INTRINSICS).expect("large enough");
    let interior = |map: Tensor<3>| map.narrow(1, 1, 5).narrow(2, 1, 7);
    let seen = found.normals * found.valid.float().unsqueeze_dim(0);

    let expected = interior(vectors(&derived::depth_normals(&surface, &INTRINSICS))).into_data();
    seen.clone().into_data().assert_approx_eq::<f32>(&expected, burn::tensor::Tolerance::absolute(1e-4));
    let weights_tensor = Tensor::<3>::from_data(interior(vectors(&weights)).into_data(), &seen.device());
    let grads = (seen * weights_tensor).sum().backward();
    let expected = of_grid(&derived::depth_normals_backward(&surface, &INTRINSICS, &weights)).into_data();
    let found = tracked.grad(&grads).expect("tracked").into_data();
    found.assert_approx_eq::<f32>(&expected, burn::tensor::Tolerance::rel_abs(1e-3, 1e-2));
}

#[test]
fn surfels_in_their_plane_are_aligned_and_turned_ones_cost_their_weight() {
    let facing = DVec3::new(0.3, -0.4, -0.8).normalize();
    let depth = of_grid(&plane(facing, 9, 7));
    let alpha = map(9, 7, |_, _| 0.8);
    let blended = |normal: DVec3| vectors(&Grid::filled(9, 7, (0.8 * normal).as_vec3().to_array()));
    assert_is(alignment(alpha.clone(), blended(facing), depth.clone(), &INTRINSICS), 0.0);
    // At an angle of 60 degrees, every bit of alpha costs a half.
    let turned = (0.5 * facing + 0.75f64.sqrt() * facing.any_orthonormal_vector()).normalize();
    assert_is(alignment(alpha.clone(), blended(turned), depth.clone(), &INTRINSICS), 0.8 * 0.5);
    // Without depth there is nothing to be aligned with; nor is there in a map without an interior.
    assert_is(alignment(alpha.clone(), blended(turned), depth * 0.0, &INTRINSICS), 0.0);
    assert_is(
        alignment(map(9, 2, |_, _| 0.8), vectors(&Grid::filled(9, 2, [0.0; 3])), map(9, 2, |_, _| 1.0), &INTRINSICS),
        0.0,
    );
}

#[test]
fn ssim_is_the_value_of_an_independent_implementation() {
    // The number that surfel-eval's metric is held to, printed by its ssim_scipy.py.
    assert_is(ssim(picture(40, 30, 0.0), picture(40, 30, 0.8)), 0.585_750_590_303);
    assert_is(ssim(picture(20, 20, 0.3), picture(20, 20, 0.3)), 1.0);
}
