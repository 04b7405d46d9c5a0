//! The slow, obvious forms of the fast kernels: one pixel at a time, in the words of their definitions.
//!
//! Nothing on the road uses them. The tests prove every fast kernel equal to its twin and the bench prints how much
//! faster it is; a change of a definition begins here. Invariant: no twin shares a loop with its kernel.

use crate::config::{CostWeights, Refinement, Smoothness};
use crate::cost_volume::{CostVolume, MatchImage};
use crate::feature_costs::FeatureGrid;
use crate::plane_fit::{Evidence, Plane, neighbourhood, reach, solve_symmetric};
use crate::semi_global::JumpPrice;
use crate::slanted::{Correction, REACH, Votes};
use crate::warp::{Landing, Warp};
use crate::window_correlation::{NUM_SHIFTS, window};
use crate::zncc::VARIANCE_FLOOR;
use surfel_core::Grid;

/// Twin of [`CostVolume::sweep`]: cost in \[0, 1\] of reference pixel `(x, y)` at inverse depth `w` in one source;
/// `None` where the source does not see it.
pub fn source_cost(
    reference: &MatchImage,
    source: &MatchImage,
    w: f64,
    (x, y): (usize, usize),
    weights: &CostWeights,
) -> Option<f32> {
    let warp = Warp::new(reference.camera, source.camera);
    if !sees(source, &warp.land(x as f64, y as f64, w)) {
        return None;
    }
    let last_row = reference.gray.height() as isize - 1;
    let correlation = |radius: usize| {
        let mut pairs = Vec::new();
        for (dx, dy) in square(radius) {
            // Windows are clipped at the sides; above and below, the border is repeated.
            let (px, py) = (x as isize + dx, (y as isize + dy).clamp(0, last_row));
            if let Some(&a) = reference.gray.get(px, py) {
                let landing = warp.land(px as f64, py as f64, w);
                pairs.push((1.0, f64::from(a), sample(source, &landing)));
            }
        }
        weighted_correlation(&pairs) as f32
    };
    let photometric = weights.small * (1.0 - correlation(weights.small_radius))
        + weights.wide * (1.0 - correlation(weights.wide_radius));
    let (features, feature_weight) = match reference.features.zip(source.features) {
        Some((a, b)) => (feature_cost(&a, &b, &warp, w, (x, y)), weights.features),
        None => (0.0, 0.0),
    };
    let total = weights.small + weights.wide + feature_weight;
    Some((0.5 * (photometric + feature_weight * features) / total).clamp(0.0, 1.0))
}

/// `1 - cosine` at the four feature pixels around `(x, y)`, interpolated.
fn feature_cost(a: &FeatureGrid, b: &FeatureGrid, warp: &Warp, w: f64, (x, y): (usize, usize)) -> f32 {
    let cost = |fx: usize, fy: usize| {
        let landing = warp.land(a.origin + a.stride * fx as f64, a.origin + a.stride * fy as f64, w);
        let (bx, by) = ((landing.x - b.origin) / b.stride, (landing.y - b.origin) / b.stride);
        let (max_x, max_y) = ((b.width - 1) as f64, (b.height - 1) as f64);
        if landing.relative_depth <= 0.0 || !(-0.5..=max_x + 0.5).contains(&bx) || !(-0.5..=max_y + 0.5).contains(&by) {
            return 1.0;
        }
        let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
        for channel in 0..a.channels {
            let value = |grid: &FeatureGrid, x, y| grid.data[(y * grid.width + x) * grid.channels + channel];
            let plane = Grid::from_fn(b.width, b.height, |x, y| value(b, x, y));
            let (own, other) = (value(a, fx, fy), plane.bilinear(bx.clamp(0.0, max_x), by.clamp(0.0, max_y)));
            let (own, other) = (f64::from(own), f64::from(other.unwrap_or(f32::NAN)));
            (ab, aa, bb) = (ab + own * other, aa + own * own, bb + other * other);
        }
        (1.0 - ab / (aa * bb).sqrt().max(1e-12)) as f32
    };
    let costs = Grid::from_fn(a.width, a.height, cost);
    let place = |i: usize, count: usize| ((i as f64 - a.origin) / a.stride).clamp(0.0, (count - 1) as f64);
    costs.bilinear(place(x, a.width), place(y, a.height)).unwrap_or(f32::NAN)
}

/// Twin of [`crate::semi_global::aggregate`]: the recursion as written in the paper, one path after the other.
/// `[height][width][candidates]`.
pub fn aggregate(volume: &CostVolume, guide: &Grid<f32>, smoothness: &Smoothness) -> Vec<i32> {
    let (w, h, n) = (volume.width as isize, volume.height as isize, volume.candidates.count);
    let price = JumpPrice::new(smoothness);
    let p1 = i32::from(price.p1);
    let mut sum = vec![0i32; volume.width * volume.height * n];
    let directions = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)];
    for (dx, dy) in directions {
        let mut path = vec![0i32; sum.len()];
        let xs: Vec<isize> = if dx >= 0 { (0..w).collect() } else { (0..w).rev().collect() };
        let ys: Vec<isize> = if dy >= 0 { (0..h).collect() } else { (0..h).rev().collect() };
        for &y in &ys {
            for &x in &xs {
                let (px, py) = (x - dx, y - dy);
                let inside = px >= 0 && py >= 0 && px < w && py < h;
                for d in 0..n {
                    let cost = i32::from(volume.at(x as usize, y as usize)[d]);
                    let value = if inside {
                        let before = &path[(py * w + px) as usize * n..][..n];
                        let least = before.iter().copied().min().unwrap_or(0);
                        let jump = price.between(guide[(x as usize, y as usize)], guide[(px as usize, py as usize)]);
                        let mut best = before[d].min(least + i32::from(jump));
                        if d > 0 {
                            best = best.min(before[d - 1] + p1);
                        }
                        if d + 1 < n {
                            best = best.min(before[d + 1] + p1);
                        }
                        cost + best - least
                    } else {
                        cost
                    };
                    path[(y * w + x) as usize * n + d] = value;
                    sum[(y * w + x) as usize * n + d] += value;
                }
            }
        }
    }
    sum
}

/// Mean evidence around a pixel.
pub fn strength(evidence: &Grid<Evidence>, (x, y): (usize, usize)) -> f32 {
    let near = square(2).filter_map(|(dx, dy)| evidence.get(x as isize + dx, y as isize + dy));
    near.map(|evidence| evidence.weight).sum::<f32>() / 25.0
}

/// Twin of [`crate::plane_fit::PlaneFit::planes`] at one pixel.
pub fn fit_plane(
    evidence: &Grid<Evidence>,
    current: Plane,
    guide: &Grid<[f32; 3]>,
    tolerance: f32,
    config: &Refinement,
    (x, y): (usize, usize),
) -> Plane {
    let at = |dx: isize, dy: isize| evidence.get(x as isize + dx, y as isize + dy);
    let inverse_reach_sq = reach(config).inverse_sq(strength(evidence, (x, y)));
    let (mut m, mut v) = ([0.0f32; 6], [0.0f32; 3]);
    for (dx, dy) in neighbourhood(config) {
        let Some(q) = at(dx, dy).filter(|q| q.weight > 0.0) else { continue };
        let colour = guide[((x as isize + dx) as usize, (y as isize + dy) as usize)];
        let colour_sq: f32 = (0..3).map(|c| (colour[c] - guide[(x, y)][c]).powi(2)).sum();
        let (dx, dy) = (dx as f32, dy as f32);
        let residual = q.w - current.at(dx, dy);
        let alike = 1.0 / (1.0 + colour_sq / config.fit_edge.powi(2));
        let agree = 1.0 / (1.0 + (residual / tolerance).powi(2));
        let near = 1.0 / (1.0 + (dx * dx + dy * dy) * inverse_reach_sq);
        let weight = q.weight * near * (alike * agree).powi(2);
        for (sum, term) in m.iter_mut().zip([1.0, dx, dy, dx * dx, dx * dy, dy * dy]) {
            *sum += weight * term;
        }
        for (sum, term) in v.iter_mut().zip([1.0, dx, dy]) {
            *sum += weight * residual * term;
        }
    }
    let [w, w_x, w_y] = solve_symmetric(m, v);
    Plane { w: current.w + w, w_x: current.w_x + w_x, w_y: current.w_y + w_y }
}

/// Twin of [`crate::slanted::correct`] at one pixel.
pub fn correct(
    reference: &MatchImage,
    sources: &[MatchImage],
    planes: &Grid<Plane>,
    shift_px: f32,
    config: &Refinement,
    (x, y): (usize, usize),
) -> Correction {
    if !reference.valid[(x, y)] {
        return Correction::default();
    }
    let warps: Vec<Warp> = sources.iter().map(|s| Warp::new(reference.camera, s.camera)).collect();
    // The inverse depth that moves a pixel by `shift_px` in the source where it moves fastest.
    let step = |x: usize, y: usize| {
        let w = f64::from(planes[(x, y)].w);
        let speeds = warps.iter().filter_map(|warp| warp.pixels_per_inverse_depth(x as f64, y as f64, w));
        f64::from(shift_px) / speeds.fold(0.0, f64::max)
    };
    let (plane, own_luma, own_step) = (planes[(x, y)], reference.gray[(x, y)], step(x, y) as f32);
    let mut votes = Votes::default();
    for (source, warp) in sources.iter().zip(&warps) {
        let carried = |x: usize, y: usize, k: usize| {
            let w = f64::from(planes[(x, y)].w) + (k as f64 - REACH as f64) * step(x, y);
            warp.land(x as f64, y as f64, w)
        };
        if !(0..NUM_SHIFTS).all(|k| sees(source, &carried(x, y, k))) {
            continue;
        }
        let (mut pairs, mut apart, mut total) = (vec![Vec::new(); NUM_SHIFTS], 0.0, 0.0);
        for (dx, dy, near) in window(config.window_radius) {
            let (px, py) = (x as isize + dx, y as isize + dy);
            let Some(&luma) = reference.gray.get(px, py) else { continue };
            let (px, py) = (px as usize, py as usize);
            let off = planes[(px, py)].w - plane.at(dx as f32, dy as f32);
            let alike = 1.0 / (1.0 + ((luma - own_luma) / config.window_edge).powi(2));
            let agree = 1.0 / (1.0 + (off / (config.window_agree_px / shift_px * own_step)).powi(2));
            let weight = near * alike * agree;
            (apart, total) = (apart + weight * off, total + weight);
            for (k, pairs) in pairs.iter_mut().enumerate() {
                pairs.push((f64::from(weight), f64::from(luma), sample(source, &carried(px, py, k))));
            }
        }
        let correlations = std::array::from_fn(|k| weighted_correlation(&pairs[k]) as f32);
        votes.add(plane.w + apart / total, correlations);
    }
    let nothing = Correction { evidence: Evidence { w: plane.w, weight: 0.0 }, correlation: 0.0 };
    votes.decide(own_step, shift_px).unwrap_or(nothing)
}

/// Offsets of the square window of a radius.
fn square(radius: usize) -> impl Iterator<Item = (isize, isize)> {
    let radius = radius as isize;
    (-radius..=radius).flat_map(move |dy| (-radius..=radius).map(move |dx| (dx, dy)))
}

/// Whether the source shows the scene at the pixel nearest to a landing.
fn sees(source: &MatchImage, landing: &Landing) -> bool {
    let nearest = ((landing.x + 0.5).floor() as isize, (landing.y + 0.5).floor() as isize);
    landing.relative_depth > 0.0 && source.valid.get(nearest.0, nearest.1) == Some(&true)
}

/// Luma at a landing; that of the nearest border outside.
fn sample(source: &MatchImage, landing: &Landing) -> f64 {
    let (max_x, max_y) = ((source.gray.width() - 1) as f64, (source.gray.height() - 1) as f64);
    source.gray.bilinear(landing.x.clamp(0.0, max_x), landing.y.clamp(0.0, max_y)).map_or(f64::NAN, f64::from)
}

/// Correlation of `(weight, a, b)`, fading to zero where either hardly varies.
fn weighted_correlation(pairs: &[(f64, f64, f64)]) -> f64 {
    let total: f64 = pairs.iter().map(|p| p.0).sum();
    let mean = |value: &dyn Fn(f64, f64) -> f64| pairs.iter().map(|&(w, a, b)| w * value(a, b)).sum::<f64>() / total;
    let (mean_a, mean_b) = (mean(&|a, _| a), mean(&|_, b| b));
    let variance_a = mean(&|a, _| (a - mean_a).powi(2)) + f64::from(VARIANCE_FLOOR);
    let variance_b = mean(&|_, b| (b - mean_b).powi(2)) + f64::from(VARIANCE_FLOOR);
    mean(&|a, b| (a - mean_a) * (b - mean_b)) / (variance_a * variance_b).sqrt()
}
