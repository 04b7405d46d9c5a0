//! A photograph packed for bilinear sampling at scattered places.
//!
//! Sampling is bound by the number of reads, so one `u32` holds a pixel and its right neighbour, each as 15 bits
//! of luma and one of validity: two reads give all four corners and say whether the nearest one shows the scene.
//! Invariant: luma is kept to half of 1/32767 of the range of the photograph, far below its own noise.

use crate::vector::whole;
use crate::warp::Warp;
use surfel_core::Grid;

/// Largest luma code.
const CODES: f32 = 32_767.0;

/// Luma that is sampled as zero: differences from it are small, and so are the rounding errors of their squares.
pub const MID_GREY: f32 = 0.5;

/// Luma and validity, ready to be sampled anywhere.
pub struct PackedImage {
    /// Rows of pairs, a pixel in the low half and its right neighbour in the high one. The last row is there twice
    /// and the last pixel of a row is its own neighbour.
    pairs: Vec<u32>,
    width: usize,
    height: usize,
    /// Luma per code.
    scale: f32,
    /// Luma of code 0.
    low: f32,
}

/// How a row of reference pixels lands in a source: at `start + x step + w parallax`, homogeneous.
#[derive(Clone, Copy, Debug)]
pub struct RowWarp {
    start: [f32; 3],
    step: [f32; 3],
    parallax: [f32; 3],
}

impl RowWarp {
    /// Row `y` of the reference under a warp.
    pub fn new(warp: &Warp, y: usize) -> Self {
        Self::along(warp, (0.0, y as f64), 1.0)
    }

    /// The places `pitch` pixels apart, to the right of index coordinates `(x, y)`.
    pub fn along(warp: &Warp, (x, y): (f64, f64), pitch: f64) -> Self {
        let start = warp.at_infinity(x, y);
        let single = |v: glam::DVec3| v.as_vec3().to_array();
        Self {
            start: single(start),
            step: single(warp.at_infinity(x + pitch, y) - start),
            parallax: single(warp.parallax()),
        }
    }

    /// Change of the homogeneous coordinates per unit of inverse depth.
    pub fn parallax(&self) -> [f32; 3] {
        self.parallax
    }

    /// Homogeneous index coordinates in the source of place number `t` at inverse depth `w`.
    #[inline(always)]
    pub fn at(&self, t: f32, w: f32) -> [f32; 3] {
        std::array::from_fn(|i| self.start[i] + self.step[i] * t + self.parallax[i] * w)
    }
}

/// Smallest ratio of the depths in source and reference at which a point lies ahead of the source.
pub const MIN_AHEAD: f32 = 1e-6;

/// Room for the corners of a row of samples, kept between rows.
#[derive(Default)]
pub struct SampleRow {
    corner: Vec<u32>,
    fraction_x: Vec<f32>,
    fraction_y: Vec<f32>,
    inside: Vec<u32>,
    top: Vec<u32>,
    bottom: Vec<u32>,
}

impl PackedImage {
    /// Packs an image of at least one pixel.
    pub fn new(gray: &Grid<f32>, valid: &Grid<bool>) -> Self {
        let (width, height) = (gray.width(), gray.height());
        let finite = || gray.as_slice().iter().copied().filter(|v| v.is_finite());
        let (low, high) = (finite().fold(f32::INFINITY, f32::min), finite().fold(f32::NEG_INFINITY, f32::max));
        let low = if low.is_finite() { low } else { MID_GREY };
        let range = if high > low { high - low } else { 1.0 };
        let code = |luma: f32, valid: bool| {
            // The cast takes what is not finite to the ends of the range.
            let code = ((luma - low) / range * CODES + 0.5) as u32;
            code.min(CODES as u32) << 1 | u32::from(valid)
        };
        let mut pairs = vec![0; width * (height + 1)];
        for (y, row) in pairs.chunks_exact_mut(width).enumerate() {
            let y = y.min(height - 1);
            let pixels = gray.row(y).iter().zip(valid.row(y));
            row.iter_mut().zip(pixels).for_each(|(pair, (&luma, &valid))| *pair = code(luma, valid));
            for x in 0..width {
                row[x] |= (row[(x + 1).min(width - 1)] & 0xffff) << 16;
            }
        }
        Self { pairs, width, height, scale: range / CODES, low }
    }

    /// Samples where the pixels of a row land at inverse depths `w`, one per pixel: luma relative to
    /// [`MID_GREY`], that of the nearest border outside; and whether the source shows the scene there (0 or 1).
    #[inline(always)]
    pub fn sample_row(&self, warp: &RowWarp, w: &[f32], scratch: &mut SampleRow, luma: &mut [f32], seen: &mut [u32]) {
        let n = w.len();
        for part in [&mut scratch.corner, &mut scratch.inside, &mut scratch.top, &mut scratch.bottom] {
            part.resize(n, 0);
        }
        scratch.fraction_x.resize(n, 0.0);
        scratch.fraction_y.resize(n, 0.0);
        let SampleRow { corner, fraction_x, fraction_y, inside, top, bottom } = scratch;
        let (corner, inside, top, bottom) = (&mut corner[..n], &mut inside[..n], &mut top[..n], &mut bottom[..n]);
        let (fraction_x, fraction_y) = (&mut fraction_x[..n], &mut fraction_y[..n]);
        let (max_x, max_y) = ((self.width - 1) as f32, (self.height - 1) as f32);
        let width = self.width as u32;
        for x in 0..n {
            let [qx, qy, z] = warp.at(x as i32 as f32, w[x]);
            let ahead = z > MIN_AHEAD;
            let inverse = if ahead { 1.0 / z } else { 0.0 };
            let (sx, sy) = (qx * inverse, qy * inverse);
            let within = (sx >= -0.5) & (sy >= -0.5) & (sx <= max_x + 0.5) & (sy <= max_y + 0.5);
            let (cx, cy) = (sx.max(0.0).min(max_x), sy.max(0.0).min(max_y));
            let (left, above) = (cx.floor(), cy.floor());
            fraction_x[x] = cx - left;
            fraction_y[x] = cy - above;
            corner[x] = whole(above).wrapping_mul(width).wrapping_add(whole(left));
            inside[x] = u32::from(ahead & within);
        }
        for x in 0..n {
            let at = corner[x] as usize;
            top[x] = self.pairs[at];
            bottom[x] = self.pairs[at + self.width];
        }
        let (luma, seen) = (&mut luma[..n], &mut seen[..n]);
        let (scale, low) = (self.scale, self.low - MID_GREY);
        for x in 0..n {
            let (top, bottom, fx, fy) = (top[x], bottom[x], fraction_x[x], fraction_y[x]);
            let codes = |pair: u32| ((pair >> 1 & 0x7fff) as i32 as f32, (pair >> 17) as i32 as f32);
            let ((p00, p10), (p01, p11)) = (codes(top), codes(bottom));
            let (above, below) = (p00 + (p10 - p00) * fx, p01 + (p11 - p01) * fx);
            luma[x] = low + scale * (above + (below - above) * fy);
            let row = if fy < 0.5 { top } else { bottom };
            let nearest = if fx < 0.5 { row } else { row >> 16 };
            seen[x] = nearest & inside[x];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use surfel_core::{Camera, Intrinsics, Rigid};

    #[test]
    fn rows_equal_single_samples() {
        let (width, height) = (41, 33);
        let camera = |rotation, translation| Camera {
            intrinsics: Intrinsics { fx: 45.0, fy: 45.0, cx: 20.0, cy: 16.0 },
            width,
            height,
            camera_from_world: Rigid::from_quat(rotation, translation),
        };
        let reference = camera(DQuat::IDENTITY, DVec3::ZERO);
        let source = camera(DQuat::from_rotation_y(0.2), DVec3::new(-0.5, 0.1, 0.2));
        let warp = Warp::new(&reference, &source);
        let gray = Grid::from_fn(width, height, |x, y| ((x * 7919 + y * 104_729) % 1009) as f32 / 800.0);
        let valid = Grid::from_fn(width, height, |x, y| (x / 4 + y / 3) % 5 != 0);
        let packed = PackedImage::new(&gray, &valid);
        let (mut scratch, mut num_seen, mut num_hidden) = (SampleRow::default(), 0, 0);
        for y in 0..height {
            let w: Vec<f32> = (0..width).map(|x| 0.1 + 0.4 * ((x + y) % 7) as f32).collect();
            let (mut luma, mut seen) = (vec![0.0; width], vec![0; width]);
            packed.sample_row(&RowWarp::new(&warp, y), &w, &mut scratch, &mut luma, &mut seen);
            for x in 0..width {
                let landing = warp.land(x as f64, y as f64, f64::from(w[x]));
                let near_edge = |v: f64, max: usize| {
                    let from_pixel_edge = ((v + 0.5) - (v + 0.5).round()).abs();
                    from_pixel_edge < 1e-3 || (v - max as f64).abs() < 1e-3 || v.abs() < 1e-3
                };
                if near_edge(landing.x, width - 1) || near_edge(landing.y, height - 1) {
                    continue;
                }
                let clamped = (landing.x.clamp(0.0, (width - 1) as f64), landing.y.clamp(0.0, (height - 1) as f64));
                let expected = gray.bilinear(clamped.0, clamped.1).unwrap();
                assert!((luma[x] + MID_GREY - expected).abs() < 3e-4, "luma at {x},{y}");
                let nearest = ((clamped.0 + 0.5) as usize, (clamped.1 + 0.5) as usize);
                let inside = (landing.x - clamped.0).abs() <= 0.5 && (landing.y - clamped.1).abs() <= 0.5;
                assert_eq!(seen[x] == 1, inside && valid[nearest], "seen at {x},{y}");
                if seen[x] == 1 { num_seen += 1 } else { num_hidden += 1 }
            }
        }
        assert!(num_seen > 300 && num_hidden > 300, "{num_seen} seen, {num_hidden} hidden");
    }

    #[test]
    fn an_image_without_contrast_is_sampled_as_it_is() {
        let (gray, valid) = (Grid::filled(3, 2, 0.7), Grid::filled(3, 2, true));
        let packed = PackedImage::new(&gray, &valid);
        let warp = RowWarp { start: [0.0, 0.5, 1.0], step: [1.0, 0.0, 0.0], parallax: [0.0; 3] };
        let (mut luma, mut seen) = ([0.0; 3], [0; 3]);
        packed.sample_row(&warp, &[1.0; 3], &mut SampleRow::default(), &mut luma, &mut seen);
        assert!(luma.iter().all(|v| (v + MID_GREY - 0.7).abs() < 1e-6) && seen == [1; 3]);
    }
}
