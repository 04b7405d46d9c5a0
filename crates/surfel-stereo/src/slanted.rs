//! Photometric correction of a surface by slanted-window matching.
//!
//! Around every pixel the current plane maps a small window of the reference into each source view; the
//! window is shifted along the epipolar line in sub-pixel steps and the best bilaterally weighted
//! correlation gives a correction and, from the sharpness of its peak, how much it may be trusted.
//! Invariant: on a textured plane the correction of the exact plane is zero.

use crate::config::Refinement;
use crate::cost_volume::MatchImage;
use crate::plane_fit::{Evidence, Plane};
use crate::warp::Warp;
use crate::zncc::VARIANCE_FLOOR;
use rayon::prelude::*;
use surfel_core::Grid;

/// Shifts tried on either side of the current surface.
const NUM_SHIFTS: usize = 2;

/// The evidence of the photographs near the current surface.
#[derive(Clone, Copy, Debug, Default)]
pub struct Correction {
    /// Corrected inverse depth and its weight.
    pub evidence: Evidence,
    /// Best correlation in \[-1, 1\].
    pub correlation: f32,
}

/// Corrects `planes` by at most `NUM_SHIFTS * shift_px` source pixels.
pub fn correct(
    reference: &MatchImage,
    sources: &[MatchImage],
    planes: &Grid<Plane>,
    shift_px: f32,
    config: &Refinement,
) -> Grid<Correction> {
    let (width, height) = (planes.width(), planes.height());
    let warps: Vec<Warp> = sources.iter().map(|s| Warp::new(reference.camera, s.camera)).collect();
    let mut corrections = Grid::filled(width, height, Correction::default());
    corrections.as_mut_slice().par_chunks_mut(width).enumerate().for_each_init(Window::default, |window, (y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            if reference.valid[(x, y)] {
                window.read(reference.gray, x, y, config);
                *out = window.correct(sources, &warps, planes[(x, y)], x, y, shift_px);
            }
        }
    });
    corrections
}

/// The reference window: offsets, values and bilateral weights of its pixels.
#[derive(Default)]
struct Window {
    samples: Vec<Sample>,
    mean: f32,
    variance: f32,
    total: f32,
}

#[derive(Clone, Copy)]
struct Sample {
    dx: f32,
    dy: f32,
    value: f32,
    weight: f32,
}

impl Window {
    fn read(&mut self, gray: &Grid<f32>, x: usize, y: usize, config: &Refinement) {
        let radius = config.window_radius as isize;
        let own = gray[(x, y)];
        self.samples.clear();
        let (mut total, mut sum, mut sum_sq) = (0.0f32, 0.0f32, 0.0f32);
        // A checkerboard of the window: half the samples, the same support.
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                if (dx + dy) % 2 != 0 {
                    continue;
                }
                let Some(&value) = gray.get(x as isize + dx, y as isize + dy) else { continue };
                let distance_sq = (dx * dx + dy * dy) as f32 / (radius * radius) as f32;
                let t = (value - own) / config.window_edge;
                let weight = (-distance_sq).exp() / (1.0 + t * t);
                total += weight;
                sum += weight * value;
                sum_sq += weight * value * value;
                self.samples.push(Sample { dx: dx as f32, dy: dy as f32, value, weight });
            }
        }
        self.total = total;
        self.mean = sum / total;
        self.variance = (sum_sq / total - self.mean * self.mean).max(0.0);
    }

    fn correct(
        &self,
        sources: &[MatchImage],
        warps: &[Warp],
        plane: Plane,
        x: usize,
        y: usize,
        shift_px: f32,
    ) -> Correction {
        const COUNT: usize = 2 * NUM_SHIFTS + 1;
        // One inverse-depth step for all sources: the one that moves the fastest source by `shift_px`.
        let fastest = warps
            .iter()
            .filter_map(|w| w.pixels_per_inverse_depth(x as f64, y as f64, f64::from(plane.w)))
            .fold(0.0, f64::max);
        if fastest <= 0.0 || plane.w <= 0.0 {
            return Correction { evidence: Evidence { w: plane.w, weight: 0.0 }, correlation: 0.0 };
        }
        let step = (f64::from(shift_px) / fastest) as f32;
        let mut scores = [0.0f32; COUNT];
        let mut num_seen = 0.0f32;
        for (source, warp) in sources.iter().zip(warps) {
            let mut own = [0.0f32; COUNT];
            let mut seen = true;
            for (k, score) in own.iter_mut().enumerate() {
                let shifted = Plane { w: plane.w + (k as f32 - NUM_SHIFTS as f32) * step, ..plane };
                match self.correlation(source, warp, shifted, x, y) {
                    Some(value) => *score = value,
                    None => seen = false,
                }
            }
            // A source that sees something else here (an occluder) has no say.
            if seen && own[NUM_SHIFTS].max(own[NUM_SHIFTS - 1]).max(own[NUM_SHIFTS + 1]) > 0.2 {
                num_seen += 1.0;
                scores.iter_mut().zip(own).for_each(|(sum, value)| *sum += value);
            }
        }
        if num_seen == 0.0 {
            return Correction { evidence: Evidence { w: plane.w, weight: 0.0 }, correlation: 0.0 };
        }
        scores.iter_mut().for_each(|s| *s /= num_seen);
        let best = (0..COUNT).max_by(|&i, &j| scores[i].total_cmp(&scores[j])).unwrap_or(NUM_SHIFTS);
        let inner = best.clamp(1, COUNT - 2);
        let curvature = 2.0 * scores[inner] - scores[inner - 1] - scores[inner + 1];
        let vertex = if curvature > 1e-6 { 0.5 * (scores[inner + 1] - scores[inner - 1]) / curvature } else { 0.0 };
        let offset = (inner as f32 - NUM_SHIFTS as f32 + vertex.clamp(-1.0, 1.0)) * step;
        // Sharp peak, good correlation: trust. The curvature is per (shift_px)², made per pixel².
        let sharpness = (curvature / (shift_px * shift_px)).max(0.0);
        let quality = scores[best].clamp(0.0, 1.0);
        let weight = sharpness * quality * quality;
        Correction { evidence: Evidence { w: plane.w + offset, weight }, correlation: scores[best] }
    }

    /// Weighted correlation of the window with its image under `plane` in one source.
    fn correlation(&self, source: &MatchImage, warp: &Warp, plane: Plane, x: usize, y: usize) -> Option<f32> {
        let (x, y, w) = (x as f64, y as f64, f64::from(plane.w));
        let centre = warp.land(x, y, w);
        let (width, height) = (source.gray.width(), source.gray.height());
        let inside = |px: f64, py: f64| px >= 0.0 && py >= 0.0 && px <= (width - 1) as f64 && py <= (height - 1) as f64;
        if centre.relative_depth <= 1e-9 || !inside(centre.x, centre.y) {
            return None;
        }
        if !source.valid[((centre.x + 0.5) as usize, (centre.y + 0.5) as usize)] {
            return None;
        }
        // The window is small: its map into the source is affine to a few hundredths of a pixel.
        let right = warp.land(x + 1.0, y, w + f64::from(plane.w_x));
        let below = warp.land(x, y + 1.0, w + f64::from(plane.w_y));
        let (ax, ay) = ((right.x - centre.x) as f32, (right.y - centre.y) as f32);
        let (bx, by) = ((below.x - centre.x) as f32, (below.y - centre.y) as f32);
        let (cx, cy) = (centre.x as f32, centre.y as f32);
        let (max_x, max_y) = ((width - 1) as f32, (height - 1) as f32);
        let pixels = source.gray.as_slice();
        let (mut sum, mut sum_sq, mut product) = (0.0f32, 0.0f32, 0.0f32);
        for s in &self.samples {
            let sx = (cx + ax * s.dx + bx * s.dy).clamp(0.0, max_x);
            let sy = (cy + ay * s.dx + by * s.dy).clamp(0.0, max_y);
            let (x0, y0) = (sx as usize, sy as usize);
            let at = y0 * width + x0;
            let (step_x, step_y) = (usize::from(x0 + 1 < width), if y0 + 1 < height { width } else { 0 });
            let (fx, fy) = (sx - x0 as f32, sy - y0 as f32);
            let top = pixels[at] + (pixels[at + step_x] - pixels[at]) * fx;
            let bottom = pixels[at + step_y] + (pixels[at + step_y + step_x] - pixels[at + step_y]) * fx;
            let value = top + (bottom - top) * fy;
            sum += s.weight * value;
            sum_sq += s.weight * value * value;
            product += s.weight * value * s.value;
        }
        let mean = sum / self.total;
        let variance = (sum_sq / self.total - mean * mean).max(0.0);
        let covariance = product / self.total - mean * self.mean;
        Some(covariance / ((self.variance + VARIANCE_FLOOR) * (variance + VARIANCE_FLOOR)).sqrt())
    }
}
