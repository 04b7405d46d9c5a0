//! Plane propagation against finite differences and against planes that are known.

use surfel_net::ops::propagate::{Proposals, REACH, backward, forward};

fn noise(seed: usize) -> f32 {
    (seed as f32 * 12.9898).sin() * 0.5 + (seed as f32 * 4.1414).cos() * 0.5
}

fn proposals(planes: impl Fn(usize, usize, usize) -> [f32; 3]) -> Proposals {
    let (width, height, views) = (12, 8, 2);
    let cells = (0..views).flat_map(|v| (0..height).flat_map(move |y| (0..width).map(move |x| (v, x, y))));
    let planes = cells.map(|(v, x, y)| planes(v, x, y)).collect();
    Proposals { width, height, stride: 2, planes, offsets: vec![[0, 0], [-3, 0], [2, 2], [0, 5]] }
}

/// No lean to either side.
fn upright() -> Vec<f32> {
    vec![0.0; 2 * 96]
}

fn scores(count: usize) -> Vec<f32> {
    (0..count).map(|i| 1.5 * noise(i)).collect()
}

#[test]
fn one_plane_everywhere_comes_back_whatever_the_scores() {
    let proposals = proposals(|_, x, y| [3.0 + 0.2 * x as f32 - 0.1 * y as f32, 0.2, -0.1]);
    let planes = forward(&scores(2 * 4 * 6 * 4), &upright(), &proposals);
    for (i, value) in planes.iter().enumerate() {
        let expected = [0.0, 0.2, -0.1][i / 96 % 3];
        assert!((value - expected).abs() < 1e-5, "{i}: {value} vs {expected}");
    }
}

/// Planes on two surfaces some way apart, each a little rough.
fn two_surfaces(apart: f32) -> Proposals {
    let near = |x: usize, y: usize| if noise(3 * x + 5 * y) > 0.0 { apart } else { 0.0 };
    proposals(|v, x, y| [v as f32 + near(x, y) + noise(x + 31 * y), 0.1 * noise(7 * x + y), 0.1 * noise(x * y + 3)])
}

#[test]
fn equals_the_obvious_mean_of_the_heaviest_surface() {
    let scores = scores(2 * 4 * 4 * 6);
    let leans: Vec<f32> = (0..2 * 96).map(|i| 3.0 * noise(11 * i)).collect();
    let score = |v: usize, k: usize, y: usize, x: usize| scores[((v * 4 + k) * 4 + y / 2) * 6 + x / 2];
    for (apart, expects_choice) in [(0.0, false), (15.0, true)] {
        let proposals = two_surfaces(apart);
        let planes = forward(&scores, &leans, &proposals);
        let mut num_left_out = 0;
        for (v, y, x) in (0..2).flat_map(|v| (0..8).flat_map(move |y| (0..12).map(move |x| (v, y, x)))) {
            let at = |k: usize| proposals.at(v, x, y, k);
            let same = |j: &usize, k: usize| (at(*j)[0] - at(k)[0]).abs() <= REACH;
            let nearer = |j: usize| at(j)[0] / (2.0 + at(j)[0].abs());
            let weight = |j: usize| (score(v, j, y, x) + leans[(v * 8 + y) * 12 + x] * nearer(j)).exp();
            let mass = |k: usize| (0..4).filter(|j| same(j, k)).map(weight).sum::<f32>();
            let heaviest = (0..4).max_by(|a, b| mass(*a).total_cmp(&mass(*b))).unwrap();
            let surface: Vec<usize> = (0..4).filter(|j| same(j, heaviest)).collect();
            num_left_out += 4 - surface.len();
            for channel in 0..3 {
                let sum: f32 = surface.iter().map(|&k| weight(k) * at(k)[channel]).sum();
                let (expected, found) = (sum / mass(heaviest), planes[((v * 3 + channel) * 8 + y) * 12 + x]);
                assert!((found - expected).abs() < 1e-4, "{found} vs {expected}");
            }
        }
        assert_eq!(num_left_out > 100, expects_choice, "{num_left_out} proposals left out");
    }
}

#[test]
fn an_undecided_pixel_is_never_put_between_two_surfaces() {
    let proposals = proposals(|_, x, _| [if x < 6 { 0.0 } else { 20.0 }, 0.0, 0.0]);
    let planes = forward(&vec![0.0; 2 * 4 * 4 * 6], &upright(), &proposals);
    let relative: Vec<f32> = planes.chunks(96).step_by(3).flatten().copied().collect();
    assert!(relative.iter().all(|w| [-20.0, 0.0, 20.0].contains(w)), "{relative:?}");
}

#[test]
fn leaning_pixels_of_one_block_join_different_surfaces() {
    // The edge runs through the blocks of columns 4 and 5; both pixels are offered both surfaces.
    let proposals = proposals(|_, x, _| [if x < 5 { 0.0 } else { 20.0 }, 0.0, 0.0]);
    let leans: Vec<f32> = (0..2 * 96).map(|i| if i % 12 < 5 { -9.0 } else { 9.0 }).collect();
    let planes = forward(&vec![0.0; 2 * 4 * 4 * 6], &leans, &proposals);
    let row = &planes[..12];
    assert!(row.iter().all(|w| *w == 0.0), "{row:?}");
}

#[test]
fn gradient_passes_finite_differences() {
    let proposals = two_surfaces(15.0);
    // No choice is so close a call here that the differences turn it.
    let scores: Vec<f32> = (0..2 * 4 * 4 * 6).map(|i| 1.5 * noise(i + 4)).collect();
    let leans: Vec<f32> = (0..2 * 96).map(|i| noise(11 * i)).collect();
    let weights: Vec<f32> = (0..2 * 3 * 96).map(|i| 4.0 * noise(5 * i + 1)).collect();
    let loss = |scores: &[f32], leans: &[f32]| -> f64 {
        forward(scores, leans, &proposals).iter().zip(&weights).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
    };
    let (of_scores, of_leans) = backward(&scores, &leans, &proposals, &weights);
    let differences = |values: &[f32], loss: &dyn Fn(&[f32]) -> f64, grad: &[f32]| {
        let mut largest = 0.0f32;
        for i in (0..values.len()).step_by(7) {
            let moved = |by: f32| {
                let mut values = values.to_vec();
                values[i] += by;
                loss(&values)
            };
            let expected = ((moved(3e-3) - moved(-3e-3)) / 6e-3) as f32;
            assert!((grad[i] - expected).abs() < 2e-3 * (1.0 + expected.abs()), "{i}: {} vs {expected}", grad[i]);
            largest = largest.max(expected.abs());
        }
        assert!(largest > 0.1, "the test sees no gradient");
    };
    differences(&scores, &|scores| loss(scores, &leans), &of_scores);
    differences(&leans, &|leans| loss(&scores, leans), &of_leans);
}
