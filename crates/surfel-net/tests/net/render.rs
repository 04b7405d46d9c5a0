//! Rendering through burn: the rasterizer's own numbers, and gradients by finite differences of its f64 twin.

use burn::tensor::{Device, Tensor, TensorData};
use glam::{DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use surfel_core::{Camera, Grid, Intrinsics, Rigid, Surfels};
use surfel_net::{DepthRange, RenderedMaps, SurfelTensors, render};
use surfel_raster::twin::{self, TwinSurfels};
use surfel_raster::{MapGrads, RasterError, RenderConfig, SurfelSlices};

const WIDTH: usize = 17;
const HEIGHT: usize = 12;
const PIXELS: usize = WIDTH * HEIGHT;

fn camera(unit: f64) -> Camera {
    Camera {
        intrinsics: Intrinsics { fx: 19.0, fy: 18.0, cx: 8.1, cy: 6.4 },
        width: WIDTH,
        height: HEIGHT,
        camera_from_world: Rigid::from_quat(DQuat::from_rotation_y(0.3), DVec3::new(0.2, -0.1, 0.4) * unit),
    }
}

const RANGE: DepthRange = DepthRange { near: 0.8, far: 5.0 };

fn config() -> RenderConfig {
    RenderConfig { background: [0.3, 0.1, 0.6], ..RANGE.render_config() }
}

/// Surfels before the camera, some below a pixel wide.
fn surfels(count: usize, sh_degree: usize, seed: u64) -> Surfels {
    let (mut rng, camera) = (StdRng::seed_from_u64(seed), camera(1.0));
    let mut out = Surfels { sh_degree, ..Surfels::default() };
    for _ in 0..count {
        let pixel = DVec2::new(rng.random_range(0.0..WIDTH as f64), rng.random_range(0.0..HEIGHT as f64));
        let depth = rng.random_range(1.0..4.0);
        let scale = |rng: &mut StdRng| (depth / camera.intrinsics.fx * rng.random_range(0.3..3.0)) as f32;
        out.centres.push(camera.unproject(pixel, depth).as_vec3().to_array());
        out.scales.push([scale(&mut rng), scale(&mut rng)]);
        out.rotations.push(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        out.opacities.push(rng.random_range(0.2..0.95));
        let num_coefficients = out.num_coefficients();
        out.sh.extend((0..num_coefficients).map(|_| std::array::from_fn::<f32, 3, _>(|_| rng.random_range(-0.3..0.6))));
    }
    out
}

fn tensors(surfels: &Surfels) -> SurfelTensors {
    let device = &Device::flex().autodiff();
    let n = surfels.len();
    let matrix = |values: &[f32], columns: usize| -> Tensor<2> {
        Tensor::from_data(TensorData::new(values.to_vec(), [n, columns]), device)
    };
    let sh = TensorData::new(surfels.sh.as_flattened().to_vec(), [n, surfels.num_coefficients(), 3]);
    SurfelTensors {
        centres: matrix(surfels.centres.as_flattened(), 3).require_grad(),
        scales: matrix(surfels.scales.as_flattened(), 2).require_grad(),
        rotations: matrix(surfels.rotations.as_flattened(), 4).require_grad(),
        opacities: Tensor::from_data(TensorData::new(surfels.opacities.clone(), [n]), device).require_grad(),
        sh: Tensor::from_data(sh, device).require_grad(),
        sh_degree: surfels.sh_degree,
    }
}

fn values<const D: usize>(tensor: &Tensor<D>) -> Vec<f32> {
    tensor.clone().into_data().try_into_vec().expect("f32")
}

/// A random linear loss: the weight of every value of every map.
fn map_grads(seed: u64) -> MapGrads {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut scalar = || Some(Grid::from_fn(WIDTH, HEIGHT, |_, _| rng.random_range(-1.0..1.0f32)));
    let (alpha, depth_expected, depth_median, distortion) = (scalar(), scalar(), scalar(), scalar());
    let mut vector =
        || Some(Grid::from_fn(WIDTH, HEIGHT, |_, _| std::array::from_fn(|_| rng.random_range(-1.0..1.0f32))));
    let (colour, normal) = (vector(), vector());
    MapGrads { colour, alpha, depth_sum: None, depth_expected, depth_median, normal, distortion }
}

/// That loss, through burn.
fn loss(maps: &RenderedMaps, grads: &MapGrads) -> Tensor<1> {
    let device = maps.alpha.device();
    let scalar = |map: &Tensor<2>, grads: &Option<Grid<f32>>| {
        let weights = grads.as_ref().expect("weighted").as_slice().to_vec();
        (map.clone() * Tensor::<2>::from_data(TensorData::new(weights, [HEIGHT, WIDTH]), &device)).sum()
    };
    let vector = |map: &Tensor<3>, grads: &Option<Grid<[f32; 3]>>| {
        let weights = grads.as_ref().expect("weighted").as_slice().as_flattened().to_vec();
        let weights = Tensor::<3>::from_data(TensorData::new(weights, [HEIGHT, WIDTH, 3]), &device);
        (map.clone() * weights.permute([2, 0, 1])).sum()
    };
    vector(&maps.colour, &grads.colour)
        + scalar(&maps.alpha, &grads.alpha)
        + scalar(&maps.depth_expected, &grads.depth_expected)
        + scalar(&maps.depth_median, &grads.depth_median)
        + vector(&maps.normal, &grads.normal)
        + scalar(&maps.distortion, &grads.distortion)
}

/// Gradients of centres, scales, rotations, opacities and SH through burn, flat.
fn burn_grads(scene: &Surfels, weights: &MapGrads) -> [Vec<f32>; 5] {
    let surfels = tensors(scene);
    let maps = render(&surfels, &camera(1.0), &config()).expect("a sound scene");
    let grads = loss(&maps, weights).backward();
    let matrix = |tensor: &Tensor<2>| values(&tensor.grad(&grads).expect("tracked"));
    [
        matrix(&surfels.centres),
        matrix(&surfels.scales),
        matrix(&surfels.rotations),
        values(&surfels.opacities.grad(&grads).expect("tracked")),
        values(&surfels.sh.grad(&grads).expect("tracked")),
    ]
}

#[test]
fn maps_are_the_rasterizers() {
    let scene = surfels(60, 2, 1);
    let maps = render(&tensors(&scene), &camera(1.0), &config()).expect("a sound scene");
    let direct = surfel_raster::render(&SurfelSlices::from(&scene), &camera(1.0), &config()).expect("a sound scene");
    assert!(direct.alpha.as_slice().iter().filter(|&&a| a > 0.5).count() > PIXELS / 4, "too little is seen");
    let interleaved = |map: &Tensor<3>| values(&map.clone().permute([1, 2, 0]));
    assert_eq!(maps.colour.dims(), [3, HEIGHT, WIDTH]);
    assert_eq!(interleaved(&maps.colour), direct.colour.as_slice().as_flattened());
    assert_eq!(interleaved(&maps.normal), direct.normal.as_slice().as_flattened());
    assert_eq!(values(&maps.alpha), direct.alpha.as_slice());
    assert_eq!(values(&maps.depth_expected), direct.depth_expected.as_slice());
    assert_eq!(values(&maps.depth_median), direct.depth_median.as_slice());
    assert_eq!(values(&maps.distortion), direct.distortion.as_slice());
    assert_eq!(values(&maps.surface_depth(1.0)), direct.depth_median.as_slice());
}

#[test]
fn gradients_are_the_rasterizers() {
    let (scene, weights) = (surfels(60, 2, 2), map_grads(3));
    let slices = SurfelSlices::from(&scene);
    let (_, tape) = surfel_raster::forward(&slices, &camera(1.0), &config()).expect("a sound scene");
    let direct = surfel_raster::backward(&slices, &tape, &weights).expect("a sound scene");
    let through_burn = burn_grads(&scene, &weights);
    assert!(direct.centres.iter().filter(|g| **g != [0.0; 3]).count() > 30, "too few surfels are seen");
    assert_eq!(through_burn[0], direct.centres.as_flattened());
    assert_eq!(through_burn[1], direct.scales.as_flattened());
    assert_eq!(through_burn[2], direct.rotations.as_flattened());
    assert_eq!(through_burn[3], direct.opacities);
    assert_eq!(through_burn[4], direct.sh.as_flattened());
}

/// The loss of the f64 twin.
fn twin_loss(surfels: &TwinSurfels, weights: &MapGrads) -> f64 {
    let pixels = twin::render(surfels, &camera(1.0), &config()).expect("a sound scene");
    let scalar = |grads: &Option<Grid<f32>>, i: usize| f64::from(grads.as_ref().expect("weighted").as_slice()[i]);
    let vector = |grads: &Option<Grid<[f32; 3]>>, i: usize| {
        DVec3::from(grads.as_ref().expect("weighted").as_slice()[i].map(f64::from))
    };
    let of_pixel = |(i, pixel): (usize, &twin::TwinPixel)| {
        vector(&weights.colour, i).dot(pixel.colour.into())
            + scalar(&weights.alpha, i) * pixel.alpha
            + scalar(&weights.depth_expected, i) * pixel.depth_expected()
            + scalar(&weights.depth_median, i) * pixel.depth_median
            + vector(&weights.normal, i).dot(pixel.normal.into())
            + scalar(&weights.distortion, i) * pixel.distortion
    };
    pixels.as_slice().iter().enumerate().map(of_pixel).sum()
}

#[test]
fn gradients_through_burn_equal_finite_differences() {
    let (scene, weights) = (surfels(6, 1, 4), map_grads(5));
    let through_burn = burn_grads(&scene, &weights);
    let start = TwinSurfels::from(&SurfelSlices::from(&scene));
    let (mut usable, mut total) = (0, 0);
    let mut verify = |found: f32, parameter: &dyn Fn(&mut TwinSurfels) -> &mut f64| {
        let slope = |step: f64| {
            let at = |step: f64| {
                let mut moved = start.clone();
                *parameter(&mut moved) += step;
                twin_loss(&moved, &weights)
            };
            (at(step) - at(-step)) / (2.0 * step)
        };
        // Where a decision tips over between two steps, halving them changes the answer.
        let (coarse, fine) = (slope(2e-7), slope(1e-7));
        total += 1;
        if (coarse - fine).abs() < 1e-3 * fine.abs().max(0.1) {
            usable += 1;
            assert!((f64::from(found) - fine).abs() < 2e-3 * fine.abs().max(1.0), "{found}, differences say {fine}");
        }
    };
    for k in 0..scene.len() {
        (0..3).for_each(|i| verify(through_burn[0][3 * k + i], &|s| &mut s.shapes[k].centre[i]));
        (0..2).for_each(|i| verify(through_burn[1][2 * k + i], &|s| &mut s.shapes[k].scales[i]));
        (0..4).for_each(|i| verify(through_burn[2][4 * k + i], &|s| &mut s.shapes[k].rotation[i]));
        verify(through_burn[3][k], &|s| &mut s.shapes[k].opacity);
        (0..12).for_each(|i| verify(through_burn[4][12 * k + i], &|s| &mut s.sh[k][i / 3][i % 3]));
    }
    assert!(usable * 10 > total * 9, "only {usable} of {total} differences were usable");
}

#[test]
fn only_what_asks_for_gradients_gets_them() {
    let mut surfels = tensors(&surfels(10, 0, 6));
    surfels.centres = surfels.centres.set_require_grad(false);
    let maps = render(&surfels, &camera(1.0), &config()).expect("a sound scene");
    let grads = maps.alpha.sum().backward();
    assert!(surfels.centres.grad(&grads).is_none());
    assert!(values(&surfels.opacities.grad(&grads).expect("tracked")).iter().any(|&g| g != 0.0));
}

#[test]
fn a_loss_that_is_not_finite_poisons_the_gradients_and_nothing_panics() {
    let surfels = tensors(&surfels(10, 0, 7));
    let maps = render(&surfels, &camera(1.0), &config()).expect("a sound scene");
    let grads = (maps.alpha.sum() * f32::NAN).backward();
    assert!(values(&surfels.scales.grad(&grads).expect("tracked")).iter().all(|g| g.is_nan()));
}

#[test]
fn a_scene_in_other_units_renders_the_same() {
    let small = surfels(40, 1, 8);
    let mut large = small.clone();
    large.centres.as_flattened_mut().iter_mut().for_each(|c| *c *= 1000.0);
    large.scales.as_flattened_mut().iter_mut().for_each(|s| *s *= 1000.0);
    let maps = |surfels: &Surfels, unit: f64| {
        let config = DepthRange { near: RANGE.near * unit, far: RANGE.far * unit }.render_config();
        render(&tensors(surfels), &camera(unit), &config).expect("a sound scene")
    };
    let (small, large) = (maps(&small, 1.0), maps(&large, 1000.0));
    let close = |a: Vec<f32>, b: Vec<f32>| {
        a.iter().zip(&b).for_each(|(a, b)| assert!((a - b).abs() < 1e-3, "{a} vs {b}"));
    };
    close(values(&small.colour), values(&large.colour));
    close(values(&small.normal), values(&large.normal));
    close(values(&small.distortion), values(&large.distortion));
    close(values(&small.depth_median), values(&(large.depth_median / 1000.0)));
}

#[test]
fn what_cannot_be_rendered_is_refused() {
    let device = Device::flex().autodiff();
    let sound = || tensors(&surfels(5, 0, 9));
    let mut blind = camera(1.0);
    blind.intrinsics.fx = 0.0;
    assert!(matches!(render(&sound(), &blind, &config()), Err(RasterError::Camera { .. })));
    let inverted = RenderConfig { dist_far: 0.1, ..config() };
    assert!(matches!(render(&sound(), &camera(1.0), &inverted), Err(RasterError::Config { .. })));
    let short = SurfelTensors { scales: Tensor::zeros([4, 2], &device), ..sound() };
    let error = render(&short, &camera(1.0), &config()).expect_err("4 scales for 5 surfels");
    assert_eq!(error, RasterError::Length { array: "scales", found: 8, expected: 10, surfels: 5 });
    let coloured = SurfelTensors { sh_degree: 4, ..sound() };
    assert_eq!(render(&coloured, &camera(1.0), &config()).expect_err("degree 4"), RasterError::ShDegree(4));
}

#[test]
fn no_surfels_show_the_background() {
    let nothing = Surfels { sh_degree: 1, ..Surfels::default() };
    let maps = render(&tensors(&nothing), &camera(1.0), &config()).expect("nothing is no error");
    assert_eq!(values(&maps.alpha), vec![0.0; PIXELS]);
    assert_eq!(values(&maps.colour.narrow(0, 2, 1)), vec![0.6; PIXELS]);
}
