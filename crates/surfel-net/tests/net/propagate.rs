//! Plane propagation against finite differences and against planes that are known.

use surfel_net::ops::propagate::{Proposals, backward, forward};

fn noise(seed: usize) -> f32 {
    (seed as f32 * 12.9898).sin() * 0.5 + (seed as f32 * 4.1414).cos() * 0.5
}

fn proposals(planes: impl Fn(usize, usize, usize) -> [f32; 3]) -> Proposals {
    let (width, height, views) = (12, 8, 2);
    let cells = (0..views).flat_map(|v| (0..height).flat_map(move |y| (0..width).map(move |x| (v, x, y))));
    let planes = cells.map(|(v, x, y)| planes(v, x, y)).collect();
    Proposals { width, height, stride: 2, planes, offsets: vec![[0, 0], [-3, 0], [2, 2], [0, 5]] }
}

fn scores(count: usize) -> Vec<f32> {
    (0..count).map(|i| 1.5 * noise(i)).collect()
}

#[test]
fn one_plane_everywhere_comes_back_whatever_the_scores() {
    let proposals = proposals(|_, x, y| [3.0 + 0.2 * x as f32 - 0.1 * y as f32, 0.2, -0.1]);
    let planes = forward(&scores(2 * 4 * 6 * 4), &proposals);
    for (i, value) in planes.iter().enumerate() {
        let expected = [0.0, 0.2, -0.1][i / 96 % 3];
        assert!((value - expected).abs() < 1e-5, "{i}: {value} vs {expected}");
    }
}

#[test]
fn equals_the_obvious_sum() {
    let proposals = proposals(|v, x, y| [v as f32 + noise(x + 31 * y), noise(7 * x + y), noise(x * y + 3)]);
    let scores = scores(2 * 4 * 4 * 6);
    let planes = forward(&scores, &proposals);
    let score = |v: usize, k: usize, y: usize, x: usize| scores[((v * 4 + k) * 4 + y / 2) * 6 + x / 2];
    for v in 0..2 {
        for y in 0..8 {
            for x in 0..12 {
                let total: f32 = (0..4).map(|k| score(v, k, y, x).exp()).sum();
                for channel in 0..3 {
                    let sum = |k: usize| score(v, k, y, x).exp() / total * proposals.at(v, x, y, k)[channel];
                    let expected: f32 = (0..4).map(sum).sum();
                    let found = planes[((v * 3 + channel) * 8 + y) * 12 + x];
                    assert!((found - expected).abs() < 1e-5, "{found} vs {expected}");
                }
            }
        }
    }
}

#[test]
fn gradient_passes_finite_differences() {
    let proposals = proposals(|v, x, y| [v as f32 + 2.0 * noise(x + 31 * y), noise(7 * x + y), noise(x * y + 3)]);
    let scores = scores(2 * 4 * 4 * 6);
    let weights: Vec<f32> = (0..2 * 3 * 96).map(|i| noise(5 * i + 1)).collect();
    let loss = |scores: &[f32]| -> f64 {
        forward(scores, &proposals).iter().zip(&weights).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
    };
    let grad = backward(&scores, &proposals, &weights);
    let mut largest = 0.0f32;
    for i in (0..scores.len()).step_by(7) {
        let moved = |by: f32| {
            let mut scores = scores.clone();
            scores[i] += by;
            loss(&scores)
        };
        let expected = ((moved(1e-2) - moved(-1e-2)) / 2e-2) as f32;
        assert!((grad[i] - expected).abs() < 2e-3 * (1.0 + expected.abs()), "{i}: {} vs {expected}", grad[i]);
        largest = largest.max(expected.abs());
    }
    assert!(largest > 0.1, "the test sees no gradient");
}
