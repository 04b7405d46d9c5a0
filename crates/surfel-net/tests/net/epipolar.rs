//! Epipolar attention: its lines against projection, its values against explicit softmax in f64, its gradient against
//! finite differences, and who can reach whom.

use burn::tensor::{Device, Tensor, TensorData, Tolerance};
use glam::{DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use std::sync::Arc;
use surfel_core::{Camera, Intrinsics, Rigid};
use surfel_net::DepthRange;
use surfel_net::cost_volume::{uniform_candidates, warps};
use surfel_net::ops::epipolar::{EpipolarLines, Landing};
use surfel_net::ops::epipolar_attention::{Gradients, Inputs, backward, forward};

const WIDTH: usize = 12;
const HEIGHT: usize = 9;
const VIEWS: usize = 3;
const CANDIDATES: usize = 6;
const CHANNELS: usize = 20;
const HEADS: usize = 2;
const PIXELS: usize = VIEWS * WIDTH * HEIGHT;

/// No two alike, and none with its principal point in the middle or square pixels.
fn cameras() -> Vec<Camera> {
    let camera = |v: usize| {
        let s = v as f64;
        let turned = DQuat::from_rotation_y(0.12 * s) * DQuat::from_rotation_z(0.2 * s - 0.1);
        Camera {
            intrinsics: Intrinsics { fx: 50.0 + 6.0 * s, fy: 44.0 - 3.0 * s, cx: 21.0 + 4.0 * s, cy: 20.5 - 2.0 * s },
            width: 4 * WIDTH,
            height: 4 * HEIGHT,
            camera_from_world: Rigid::from_quat(turned, DVec3::new(-0.5 * s, 0.2 * s, 0.1 * s)),
        }
    };
    (0..VIEWS).map(camera).collect()
}

fn ranges() -> Vec<DepthRange> {
    (0..VIEWS).map(|v| DepthRange { near: 1.2 + 0.1 * v as f64, far: 6.0 }).collect()
}

fn lines_of(cameras: &[Camera], ranges: &[DepthRange], neighbours: &[Vec<usize>]) -> EpipolarLines {
    let disparities = ranges.iter().map(|range| uniform_candidates(range, CANDIDATES)).collect();
    EpipolarLines { width: WIDTH, height: HEIGHT, warps: warps(cameras, neighbours, 4), disparities }
}

fn others() -> Vec<Vec<usize>> {
    (0..VIEWS).map(|v| (0..VIEWS).filter(|&o| o != v).collect()).collect()
}

fn lines() -> EpipolarLines {
    lines_of(&cameras(), &ranges(), &others())
}

fn landings(lines: &EpipolarLines, pixel: usize) -> Vec<Landing> {
    let mut landings = Vec::new();
    lines.landings(pixel, &mut landings);
    landings
}

/// Queries, keys, values, what depths add to keys, and to values.
type Values<T> = [Vec<T>; 5];

fn random(rows: usize, seed: u64) -> Vec<f32> {
    let mut rng = StdRng::seed_from_u64(seed);
    (0..rows * CHANNELS).map(|_| rng.random_range(-2.0..2.0)).collect()
}

fn values() -> Values<f32> {
    std::array::from_fn(|i| random(if i < 3 { PIXELS } else { CANDIDATES }, i as u64))
}

fn inputs(values: &Values<f32>) -> Inputs<'_> {
    let [query, key, value, depth_key, depth_value] = values;
    Inputs { query, key, value, depth_key, depth_value, channels: CHANNELS, num_heads: HEADS }
}

/// Every sample's key and value gathered, every score in a list.
fn twin(values: &Values<f64>, lines: &EpipolarLines) -> Vec<f64> {
    let [query, key, value, depth_key, depth_value] = values;
    let dim = CHANNELS / HEADS;
    let mut output = vec![0.0; PIXELS * CHANNELS];
    for pixel in 0..PIXELS {
        let landings = landings(lines, pixel);
        let sampled = |map: &[f64], depth: &[f64], at: &Landing, c: usize| {
            let corners = at.pixels.iter().zip(at.weights);
            depth[at.candidate * CHANNELS + c] + corners.map(|(p, w)| f64::from(w) * map[p * CHANNELS + c]).sum::<f64>()
        };
        for head in 0..HEADS {
            let channels = head * dim..(head + 1) * dim;
            let score = |at: &Landing| {
                let products = channels.clone().map(|c| query[pixel * CHANNELS + c] * sampled(key, depth_key, at, c));
                products.sum::<f64>() / (dim as f64).sqrt()
            };
            let exponentials: Vec<f64> = landings.iter().map(|at| score(at).exp()).collect();
            let sum: f64 = exponentials.iter().sum();
            for (at, e) in landings.iter().zip(&exponentials) {
                for c in channels.clone() {
                    output[pixel * CHANNELS + c] += e / sum * sampled(value, depth_value, at, c);
                }
            }
        }
    }
    output
}

fn in_f64(values: &Values<f32>) -> Values<f64> {
    values.each_ref().map(|values| values.iter().map(|&v| f64::from(v)).collect())
}

/// Where each candidate of a pixel falls in a neighbour, in index coordinates of the maps; `None` behind it.
fn projected(cameras: &[Camera], pixel: usize, other: usize) -> Vec<Option<DVec2>> {
    let (view, local) = (pixel / (WIDTH * HEIGHT), pixel % (WIDTH * HEIGHT));
    let centre = DVec2::new((4 * (local % WIDTH)) as f64, (4 * (local / WIDTH)) as f64) + 0.5;
    let land = |disparity: &f32| {
        let world = cameras[view].unproject(centre, 1.0 / f64::from(*disparity));
        cameras[other].project(world).map(|(landed, _)| (landed - 0.5) / 4.0)
    };
    uniform_candidates(&ranges()[view], CANDIDATES).iter().map(land).collect()
}

#[test]
fn lines_run_where_projection_says() {
    let (cameras, lines) = (cameras(), lines());
    let mut lonely = 0;
    for pixel in 0..PIXELS {
        let found = landings(&lines, pixel);
        let expected: Vec<(usize, usize, DVec2)> = others()[pixel / (WIDTH * HEIGHT)]
            .iter()
            .flat_map(|&other| {
                let landed = projected(&cameras, pixel, other).into_iter().enumerate();
                landed.filter_map(move |(candidate, at)| Some((other, candidate, at?)))
            })
            .filter(|(_, _, at)| at.cmpge(DVec2::ZERO).all())
            .filter(|(_, _, at)| at.x <= (WIDTH - 1) as f64 && at.y <= (HEIGHT - 1) as f64)
            .collect();
        assert_eq!(found.len(), expected.len(), "pixel {pixel}");
        lonely += usize::from(found.is_empty());
        for (landing, (other, candidate, at)) in found.iter().zip(expected) {
            assert_eq!(landing.candidate, candidate);
            let centre = landing.pixels.iter().zip(landing.weights).fold(DVec2::ZERO, |sum, (&p, w)| {
                assert_eq!(p / (WIDTH * HEIGHT), other);
                let local = p % (WIDTH * HEIGHT);
                sum + f64::from(w) * DVec2::new((local % WIDTH) as f64, (local / WIDTH) as f64)
            });
            assert!((centre - at).length() < 1e-4, "{centre} vs {at}");
        }
    }
    assert!(lonely > 0 && lonely < PIXELS / 2, "{lonely} pixels see nothing");
}

#[test]
fn equals_the_explicit_softmax() {
    let (lines, values) = (lines(), values());
    let (fast, plain) = (forward(&inputs(&values), &lines), twin(&in_f64(&values), &lines));
    for pixel in 0..PIXELS {
        let sees = !landings(&lines, pixel).is_empty();
        for i in pixel * CHANNELS..(pixel + 1) * CHANNELS {
            assert!((f64::from(fast[i]) - plain[i]).abs() < 1e-4, "{i}: {} vs {}", fast[i], plain[i]);
            assert!(sees || fast[i] == 0.0);
        }
    }
}

#[test]
fn only_what_lies_on_the_line_reaches_a_pixel() {
    let (cameras, lines, values) = (cameras(), lines(), values());
    let before = forward(&inputs(&values), &lines);
    for pixel in (5..PIXELS).step_by(23) {
        let of_pixel = |output: &[f32]| output[pixel * CHANNELS..(pixel + 1) * CHANNELS].to_vec();
        // The line through the two ends of the range, wherever they fall; an interpolated sample reaches less than the
        // diagonal of a cell.
        let near_line = |p: usize| {
            let (other, local) = (p / (WIDTH * HEIGHT), p % (WIDTH * HEIGHT));
            if other == pixel / (WIDTH * HEIGHT) {
                return false;
            }
            let landed = projected(&cameras, pixel, other);
            let (Some(a), Some(b)) = (landed[0], landed[CANDIDATES - 1]) else { return true };
            let to = DVec2::new((local % WIDTH) as f64, (local / WIDTH) as f64) - a;
            to.perp_dot((b - a).normalize()).abs() < 2f64.sqrt()
        };
        let mut off = values.clone();
        let mut changed = 0;
        for p in (0..PIXELS).filter(|&p| !near_line(p)) {
            changed += 1;
            off[1][p * CHANNELS..(p + 1) * CHANNELS].fill(7.0);
            off[2][p * CHANNELS..(p + 1) * CHANNELS].fill(-7.0);
        }
        assert!(changed > PIXELS / 3);
        assert_eq!(of_pixel(&before), of_pixel(&forward(&inputs(&off), &lines)));
        for at in landings(&lines, pixel).iter().take(1) {
            let heaviest = (0..4).max_by(|&a, &b| at.weights[a].total_cmp(&at.weights[b])).unwrap();
            for which in [1, 2] {
                let mut on = values.clone();
                on[which][at.pixels[heaviest] * CHANNELS..][..CHANNELS].iter_mut().for_each(|v| *v += 1.5);
                assert_ne!(of_pixel(&before), of_pixel(&forward(&inputs(&on), &lines)));
            }
        }
    }
}

#[test]
fn renaming_the_views_renames_the_outputs() {
    let reversed =
        |rows: &[f32]| -> Vec<f32> { rows.chunks(WIDTH * HEIGHT * CHANNELS).rev().flatten().copied().collect() };
    let values = values();
    let [query, key, value, depth_key, depth_value] = values.clone();
    let mirrored = [reversed(&query), reversed(&key), reversed(&value), depth_key, depth_value];
    let (mut cameras, mut ranges) = (cameras(), ranges());
    cameras.reverse();
    ranges.reverse();
    let expected = reversed(&forward(&inputs(&values), &lines()));
    let found = forward(&inputs(&mirrored), &lines_of(&cameras, &ranges, &others()));
    assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-4));
}

fn in_order(gradients: Gradients) -> Values<f32> {
    let Gradients { query, key, value, depth_key, depth_value } = gradients;
    [query, key, value, depth_key, depth_value]
}

#[test]
fn gradients_equal_finite_differences() {
    let (lines, values, grad) = (lines(), values(), random(PIXELS, 9));
    let analytic = in_order(backward(&inputs(&values), &lines, &grad));
    let mut at = in_f64(&values);
    let loss = |at: &Values<f64>| -> f64 { twin(at, &lines).iter().zip(&grad).map(|(o, g)| o * f64::from(*g)).sum() };
    for which in 0..5 {
        assert_eq!(analytic[which].len(), values[which].len());
        for i in (which..values[which].len()).step_by(if which < 3 { 173 } else { 13 }) {
            let (step, centre) = (1e-4, at[which][i]);
            at[which][i] = centre + step;
            let up = loss(&at);
            at[which][i] = centre - step;
            let numeric = (up - loss(&at)) / (2.0 * step);
            at[which][i] = centre;
            let found = f64::from(analytic[which][i]);
            assert!((found - numeric).abs() < 2e-3 * (1.0 + numeric.abs()), "{which} {i}: {found} vs {numeric}");
        }
    }
}

#[test]
fn burn_differentiates_through_it() {
    let device = Device::flex().autodiff();
    let (lines, values, grad) = (lines(), values(), random(PIXELS, 10));
    let map =
        |v: &[f32]| Tensor::<4>::from_data(TensorData::new(v.to_vec(), [VIEWS, HEIGHT, WIDTH, CHANNELS]), &device);
    let table = |v: &[f32]| Tensor::<2>::from_data(TensorData::new(v.to_vec(), [CANDIDATES, CHANNELS]), &device);
    let [query, key, value] = [0, 1, 2].map(|i| map(&values[i]).require_grad());
    let depths = [3, 4].map(|i| table(&values[i]).require_grad());
    let (memory, shared) = ([key.clone(), value.clone()], Arc::new(lines.clone()));
    let output = surfel_net::ops::epipolar_attention(query.clone(), memory, depths.clone(), HEADS, shared);
    let grads = (output * map(&grad)).sum().backward();
    let direct = in_order(backward(&inputs(&values), &lines, &grad));
    for (leaf, direct) in [query, key, value].iter().zip(&direct) {
        let found = leaf.grad(&grads).unwrap().into_data();
        let expected = TensorData::new(direct.clone(), [VIEWS, HEIGHT, WIDTH, CHANNELS]);
        found.assert_approx_eq::<f32>(&expected, Tolerance::absolute(1e-5));
    }
    for (leaf, direct) in depths.iter().zip(&direct[3..]) {
        let expected = TensorData::new(direct.clone(), [CANDIDATES, CHANNELS]);
        leaf.grad(&grads).unwrap().into_data().assert_approx_eq::<f32>(&expected, Tolerance::absolute(1e-5));
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let (lines, values, grad) = (lines(), values(), random(PIXELS, 11));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let grads = pool.install(|| in_order(backward(&inputs(&values), &lines, &grad)));
        (pool.install(|| forward(&inputs(&values), &lines)), grads)
    };
    assert!(run(1) == run(4));
}
