//! Photometric correction of a surface by matching windows that follow it.
//!
//! The current planes carry every pixel of the reference into each source view, and on along its epipolar line in
//! sub-pixel steps. Around every pixel a window of the reference is compared with the same window of these carried
//! images, neighbours that look alike counting most: the best correlation gives a correction and, from the
//! sharpness of its peak, how much it may be trusted. Invariant: on a textured plane the correction of the exact
//! plane is zero.

use crate::config::Refinement;
use crate::cost_volume::MatchImage;
use crate::packed::{MIN_AHEAD, PackedImage, RowWarp, SampleRow};
use crate::plane_fit::{Evidence, Plane};
use crate::warp::Warp;
use crate::window_correlation::{CorrelateRow, CorrelationRow, NUM_SHIFTS, Windows};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use surfel_core::Grid;

/// Shifts tried on either side of the current surface.
pub(crate) const REACH: usize = NUM_SHIFTS / 2;

/// Correlation up to which a source sees something else here (an occluder) and has no say.
const MIN_CORRELATION: f32 = 0.2;

/// Lost correlation that is never to be excluded: what resampling alone costs.
const LEAST_NOISE: f32 = 0.1;

/// Lost correlation at which evidence weighs as much as its peak is sharp.
const USUAL_NOISE: f32 = 0.1;

/// The evidence of the photographs near the current surface.
#[derive(Clone, Copy, Debug, Default)]
pub struct Correction {
    /// Corrected inverse depth and its weight.
    pub evidence: Evidence,
    /// Best correlation in \[-1, 1\].
    pub correlation: f32,
}

/// Corrects `planes` by at most `REACH * shift_px` source pixels.
pub fn correct(
    reference: &MatchImage,
    sources: &[MatchImage],
    planes: &Grid<Plane>,
    shift_px: f32,
    config: &Refinement,
) -> Grid<Correction> {
    let width = planes.width();
    let warps: Vec<Warp> = sources.iter().map(|s| Warp::new(reference.camera, s.camera)).collect();
    let w = planes.map(|plane| plane.w);
    let step = steps(&w, &warps, shift_px);
    let mut windows = Windows::new(reference.gray, planes, config);
    let mut votes = vec![Votes::default(); planes.len()];
    let arch = Arch::new();
    for (source, warp) in sources.iter().zip(&warps) {
        let seen = carry(&mut windows, &PackedImage::new(source.gray, source.valid), warp, &w, &step);
        votes.par_chunks_mut(width).enumerate().for_each_init(CorrelationRow::default, |row, (y, votes)| {
            let (planes, step, agree) = (planes.row(y), step.row(y), config.window_agree_px / shift_px);
            arch.dispatch(CorrelateRow { windows: &windows, y, planes, step, agree, row });
            for (x, vote) in votes.iter_mut().enumerate() {
                if seen[(x, y)] == 1 {
                    vote.add(row.believed(x), row.correlations(x));
                }
            }
        });
    }
    Grid::from_fn(width, planes.height(), |x, y| {
        if !reference.valid[(x, y)] {
            return Correction::default();
        }
        let nothing = Correction { evidence: Evidence { w: w[(x, y)], weight: 0.0 }, correlation: 0.0 };
        votes[y * width + x].decide(step[(x, y)], shift_px).unwrap_or(nothing)
    })
}

/// Per pixel, the inverse depth that moves its image by `shift_px` in the source where it moves fastest; zero
/// behind all sources.
fn steps(w: &Grid<f32>, warps: &[Warp], shift_px: f32) -> Grid<f32> {
    let mut steps = Grid::filled(w.width(), w.height(), 0.0);
    let arch = Arch::new();
    steps.as_mut_slice().par_chunks_mut(w.width()).enumerate().for_each(|(y, out)| {
        for warp in warps {
            arch.dispatch(FastestRow { warp: RowWarp::new(warp, y), w: w.row(y), fastest: out });
        }
        for (step, w) in out.iter_mut().zip(w.row(y)) {
            *step = if *step > 0.0 && *w > 0.0 { shift_px / *step } else { 0.0 };
        }
    });
    steps
}

/// Raises `fastest` to the speeds of a row in one source, pixels per inverse depth.
struct FastestRow<'a> {
    warp: RowWarp,
    w: &'a [f32],
    fastest: &'a mut [f32],
}

impl WithSimd for FastestRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let [bx, by, bz] = self.warp.parallax();
        for (x, (fastest, &w)) in self.fastest.iter_mut().zip(self.w).enumerate() {
            let [qx, qy, z] = self.warp.at(x as i32 as f32, w);
            let inverse = 1.0 / z;
            let (vx, vy) = ((bx - qx * inverse * bz) * inverse, (by - qy * inverse * bz) * inverse);
            let speed = (vx * vx + vy * vy).sqrt();
            *fastest = if z > MIN_AHEAD { fastest.max(speed) } else { *fastest };
        }
    }
}

/// Fills the carried images of a source; returns where the source sees all of them (0 or 1).
fn carry(windows: &mut Windows, image: &PackedImage, warp: &Warp, w: &Grid<f32>, step: &Grid<f32>) -> Grid<u32> {
    let mut seen = Grid::filled(w.width(), w.height(), 1u32);
    let arch = Arch::new();
    let rows = windows.carried_rows().zip(seen.as_mut_slice().par_chunks_mut(w.width())).enumerate();
    rows.for_each_init(CarryScratch::default, |scratch, (y, (carried, seen))| {
        arch.dispatch(CarryRow {
            image,
            warp: RowWarp::new(warp, y),
            w: w.row(y),
            step: step.row(y),
            scratch,
            carried,
            seen,
        });
    });
    seen
}

#[derive(Default)]
struct CarryScratch {
    w: Vec<f32>,
    seen: Vec<u32>,
    samples: SampleRow,
}

/// One row of all carried images.
struct CarryRow<'a> {
    image: &'a PackedImage,
    warp: RowWarp,
    w: &'a [f32],
    step: &'a [f32],
    scratch: &'a mut CarryScratch,
    /// `[shift][..]`, each at least as long as a row.
    carried: [&'a mut [f32]; NUM_SHIFTS],
    seen: &'a mut [u32],
}

impl WithSimd for CarryRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let CarryScratch { w: shifted, seen: seen_here, samples } = self.scratch;
        shifted.resize(self.w.len(), 0.0);
        seen_here.resize(self.w.len(), 0);
        for (k, carried) in self.carried.into_iter().enumerate() {
            let shift = k as f32 - REACH as f32;
            for (shifted, (w, step)) in shifted.iter_mut().zip(self.w.iter().zip(self.step)) {
                *shifted = w + shift * step;
            }
            self.image.sample_row(&self.warp, shifted, samples, carried, seen_here);
            for (seen, here) in self.seen.iter_mut().zip(seen_here.iter()) {
                *seen &= here;
            }
        }
    }
}

/// Correlations at each shift, summed over the sources that see the pixel.
#[derive(Clone, Copy, Default)]
pub(crate) struct Votes {
    sum: [f32; NUM_SHIFTS],
    num_sources: f32,
    /// Inverse depth at no shift.
    w: f32,
}

impl Votes {
    pub fn add(&mut self, w: f32, correlations: [f32; NUM_SHIFTS]) {
        if correlations[REACH - 1..=REACH + 1].iter().any(|&c| c > MIN_CORRELATION) {
            self.w = w;
            self.num_sources += 1.0;
            self.sum.iter_mut().zip(correlations).for_each(|(sum, value)| *sum += value);
        }
    }

    /// The shift of the best correlation, by a parabola through it and its neighbours; `None` without a source.
    pub fn decide(&self, step: f32, shift_px: f32) -> Option<Correction> {
        if self.num_sources == 0.0 || step <= 0.0 {
            return None;
        }
        let scores = self.sum.map(|sum| sum / self.num_sources);
        let best = (0..NUM_SHIFTS).max_by(|&i, &j| scores[i].total_cmp(&scores[j])).unwrap_or(REACH);
        let inner = best.clamp(1, NUM_SHIFTS - 2);
        let curvature = 2.0 * scores[inner] - scores[inner - 1] - scores[inner + 1];
        let vertex = if curvature > 1e-6 { 0.5 * (scores[inner + 1] - scores[inner - 1]) / curvature } else { 0.0 };
        let offset = (inner as f32 - REACH as f32 + vertex.clamp(-1.0, 1.0)) * step;
        // Sharp peak, good correlation: trust. The curvature is per (shift_px)², made per pixel². What noise moves a
        // peak by has the variance (1 - correlation) / sharpness.
        let sharpness = (curvature / (shift_px * shift_px)).max(0.0);
        let quality = scores[best].clamp(0.0, 1.0);
        let precision = sharpness * (LEAST_NOISE + USUAL_NOISE) / (LEAST_NOISE + 1.0 - quality);
        let weight = precision * quality * quality;
        Some(Correction { evidence: Evidence { w: self.w + offset, weight }, correlation: scores[best] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin;
    use glam::{DQuat, DVec3};
    use surfel_core::{Camera, Intrinsics, Rigid};

    const SIZE: (usize, usize) = (47, 35);

    fn camera(rotation: DQuat, translation: DVec3) -> Camera {
        Camera {
            intrinsics: Intrinsics { fx: 50.0, fy: 51.0, cx: 23.0, cy: 18.0 },
            width: SIZE.0,
            height: SIZE.1,
            camera_from_world: Rigid::from_quat(rotation, translation),
        }
    }

    /// A wavy pattern on the plane `w = 0.5 + slope`, seen by `camera`; `w` is that of the first camera.
    fn picture(camera: &Camera, reference: &Camera, w: impl Fn(f64, f64) -> f64) -> Grid<f32> {
        Grid::from_fn(SIZE.0, SIZE.1, |x, y| {
            // The point of the reference that lands here, by fixed point iteration over its pixel.
            let warp = Warp::new(reference, camera);
            let (mut rx, mut ry) = (x as f64, y as f64);
            for _ in 0..60 {
                let landing = warp.land(rx, ry, w(rx, ry));
                (rx, ry) = (rx + x as f64 - landing.x, ry + y as f64 - landing.y);
            }
            (0.5 + 0.2 * (0.9 * rx + 0.2 * ry).sin() + 0.2 * (0.35 * rx - 0.8 * ry).cos()) as f32
        })
    }

    fn surface(x: f64, y: f64) -> f64 {
        0.5 + 0.002 * x - 0.001 * y
    }

    #[test]
    fn a_textured_plane_is_left_alone() {
        let cameras =
            [camera(DQuat::IDENTITY, DVec3::ZERO), camera(DQuat::from_rotation_y(0.02), DVec3::new(-0.3, 0.02, 0.0))];
        let pictures = cameras.map(|c| picture(&c, &cameras[0], surface));
        let valid = Grid::filled(SIZE.0, SIZE.1, true);
        let [a, b] =
            [0, 1].map(|i| MatchImage { gray: &pictures[i], valid: &valid, camera: &cameras[i], features: None });
        let exact = Grid::from_fn(SIZE.0, SIZE.1, |x, y| Plane {
            w: surface(x as f64, y as f64) as f32,
            w_x: 0.002,
            w_y: -0.001,
        });
        let shift_px = 0.5;
        let px = |x: usize, y: usize| {
            let warp = Warp::new(&cameras[0], &cameras[1]);
            warp.pixels_per_inverse_depth(x as f64, y as f64, surface(x as f64, y as f64)).unwrap() as f32
        };
        // The exact plane stays, and one that is off by 0.4 pixels comes back; a small window has less to be alike.
        let wide = Refinement { window_radius: 4, window_edge: 0.1, ..Refinement::default() };
        let tries = [(wide, 0.97), (Refinement::default(), 0.95)];
        for ((config, alike), off_px) in tries.iter().flat_map(|t| [(t, 0.0), (t, 0.4)]) {
            let planes =
                Grid::from_fn(SIZE.0, SIZE.1, |x, y| Plane { w: exact[(x, y)].w + off_px / px(x, y), ..exact[(x, y)] });
            let corrected = correct(&a, &[b], &planes, shift_px, config);
            for y in 5..SIZE.1 - 5 {
                for x in 12..SIZE.0 - 5 {
                    let c = corrected[(x, y)];
                    let error_px = (c.evidence.w - exact[(x, y)].w) * px(x, y);
                    assert!(error_px.abs() < 0.1 && c.correlation > *alike, "{error_px} px at {x},{y}: {c:?}");
                }
            }
        }
    }

    #[test]
    fn equals_the_twin() {
        let cameras = [
            camera(DQuat::IDENTITY, DVec3::ZERO),
            camera(DQuat::from_rotation_y(0.05), DVec3::new(-0.2, 0.02, 0.1)),
            camera(DQuat::from_rotation_x(0.04), DVec3::new(0.05, 0.2, 0.0)),
        ];
        let noise = |x: usize, y: usize, seed: usize| ((x * 7919 + y * 104_729 + seed * 31) % 1009) as f32 / 1009.0;
        let pictures = cameras.map(|c| {
            let smooth = picture(&c, &cameras[0], surface);
            Grid::from_fn(SIZE.0, SIZE.1, |x, y| smooth[(x, y)] + 0.1 * noise(x, y, 1))
        });
        let valid = Grid::from_fn(SIZE.0, SIZE.1, |x, y| (x / 6 + y / 5) % 9 != 0);
        let image = |i: usize| MatchImage { gray: &pictures[i], valid: &valid, camera: &cameras[i], features: None };
        let sources = [image(1), image(2)];
        let planes = Grid::from_fn(SIZE.0, SIZE.1, |x, y| Plane {
            w: surface(x as f64, y as f64) as f32 + 0.02 * noise(x / 3, y / 3, 2),
            w_x: 0.002,
            w_y: -0.001 + 0.002 * noise(x, y, 3),
        });
        let config = Refinement::default();
        let fast = correct(&image(0), &sources, &planes, 0.5, &config);
        let mut num_compared = 0;
        for y in (0..SIZE.1).step_by(3) {
            for x in 0..SIZE.0 {
                let (fast, slow) = (fast[(x, y)], twin::correct(&image(0), &sources, &planes, 0.5, &config, (x, y)));
                // Where a landing is at the very edge of what a source sees, or a source at the very edge of having a
                // say, rounding decides.
                if (fast.correlation - slow.correlation).abs() < 2e-3 {
                    num_compared += 1;
                    let weight_error = (fast.evidence.weight - slow.evidence.weight).abs();
                    assert!(weight_error < 0.01 + 0.01 * slow.evidence.weight, "{fast:?} is not {slow:?} at {x},{y}");
                    let clear = slow.evidence.weight > 0.1;
                    assert!(
                        !clear || (fast.evidence.w - slow.evidence.w).abs() < 5e-4,
                        "{fast:?} is not {slow:?} at {x},{y}"
                    );
                }
            }
        }
        assert!(num_compared > SIZE.0 * SIZE.1.div_ceil(3) * 98 / 100, "only {num_compared} are alike");
    }
}
