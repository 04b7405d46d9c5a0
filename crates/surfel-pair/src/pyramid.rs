//! The Gaussian scale space in which keypoints are found and described (Lowe 2004, section 3).
//!
//! First step of sparse matching. The first octave is the image enlarged twice, because working
//! images are small; every further octave takes each second pixel. The invariant: index `x` of an
//! octave lies at continuous image coordinate `ORIGIN + x * step`.

use rayon::prelude::*;
use surfel_core::Grid;

/// Blur of the first level of every octave, in pixels of that octave (Lowe 2004, section 3.3).
pub const BASE_SIGMA: f64 = 1.6;
/// Levels per doubling of scale (Lowe 2004, section 3.2).
pub const LEVELS_PER_OCTAVE: usize = 3;
/// Blur a camera leaves in an image, pixels.
const CAMERA_SIGMA: f64 = 0.5;
/// Continuous image coordinate of index 0 in every octave: the first centre of the doubled image.
const ORIGIN: f64 = 0.25;
/// Octaves smaller than this hold no descriptor window.
const MIN_SIDE: usize = 24;

/// One octave: `LEVELS_PER_OCTAVE + 3` images of one size and growing blur.
pub struct Octave {
    /// Image pixels per octave pixel (0.5, 1, 2, ...).
    pub step: f64,
    /// Level `s` has blur `BASE_SIGMA * 2^(s / LEVELS_PER_OCTAVE)` octave pixels.
    pub levels: Vec<Grid<f32>>,
}

impl Octave {
    /// Continuous image coordinate of an octave index coordinate.
    pub fn to_image(&self, index: f64) -> f64 {
        ORIGIN + index * self.step
    }

    /// Blur of (fractional) level `s`, octave pixels.
    pub fn sigma(level: f64) -> f64 {
        BASE_SIGMA * (level / LEVELS_PER_OCTAVE as f64).exp2()
    }
}

/// Builds all octaves of a gray image, finest first; empty for an image too small to describe.
pub fn octaves(gray: &Grid<f32>) -> Vec<Octave> {
    let mut base = doubled(gray);
    let mut present_sigma = 2.0 * CAMERA_SIGMA;
    let mut step = 0.5;
    let mut octaves = Vec::new();
    while base.width().min(base.height()) >= MIN_SIDE {
        let mut levels = vec![blurred(&base, added_blur(present_sigma, BASE_SIGMA))];
        for s in 1..LEVELS_PER_OCTAVE + 3 {
            let added = added_blur(Octave::sigma(s as f64 - 1.0), Octave::sigma(s as f64));
            levels.push(blurred(&levels[s - 1], added));
        }
        base = halved(&levels[LEVELS_PER_OCTAVE]);
        octaves.push(Octave { step, levels });
        present_sigma = BASE_SIGMA;
        step *= 2.0;
    }
    octaves
}

fn added_blur(from: f64, to: f64) -> f64 {
    (to * to - from * from).max(0.0).sqrt()
}

/// Bilinear enlargement about pixel centres: every new pixel takes 3/4 of its own old pixel and 1/4 of the
/// next one on its side, along each axis.
fn doubled(gray: &Grid<f32>) -> Grid<f32> {
    let (width, height) = (gray.width(), gray.height());
    let partner =
        |i: usize, len: usize| if i.is_multiple_of(2) { (i / 2).saturating_sub(1) } else { (i / 2 + 1).min(len - 1) };
    let mut data = vec![0.0f32; 4 * width * height];
    data.par_chunks_mut((2 * width).max(1)).enumerate().for_each(|(y, out)| {
        let (own, next) = (gray.row(y / 2), gray.row(partner(y, height)));
        let column: Vec<f32> = own.iter().zip(next).map(|(own, next)| 0.75 * own + 0.25 * next).collect();
        for (x, value) in out.iter_mut().enumerate() {
            *value = 0.75 * column[x / 2] + 0.25 * column[partner(x, width)];
        }
    });
    Grid::from_vec(2 * width, 2 * height, data)
}

fn halved(grid: &Grid<f32>) -> Grid<f32> {
    Grid::from_fn(grid.width() / 2, grid.height() / 2, |x, y| grid[(2 * x, 2 * y)])
}

/// Separable Gaussian blur with replicated borders; `sigma` in pixels, 0 copies.
pub fn blurred(grid: &Grid<f32>, sigma: f64) -> Grid<f32> {
    if sigma < 1e-3 || grid.is_empty() {
        return grid.clone();
    }
    let (width, height) = (grid.width(), grid.height());
    let taps = gaussian_taps(sigma);
    let radius = taps.len() / 2;

    let mut across = vec![0.0f32; width * height];
    across.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let row = grid.row(y);
        let mut padded = vec![row[0]; radius];
        padded.extend_from_slice(row);
        padded.extend(std::iter::repeat_n(row[width - 1], radius));
        for (tap, weight) in taps.iter().enumerate() {
            accumulate(out, &padded[tap..][..width], *weight);
        }
    });

    let mut down = vec![0.0f32; width * height];
    down.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (tap, weight) in taps.iter().enumerate() {
            let source = (y + tap).saturating_sub(radius).min(height - 1);
            accumulate(out, &across[source * width..][..width], *weight);
        }
    });
    Grid::from_vec(width, height, down)
}

fn accumulate(out: &mut [f32], values: &[f32], weight: f32) {
    for (sum, value) in out.iter_mut().zip(values) {
        *sum += weight * value;
    }
}

/// Normalised taps out to 4 sigma.
fn gaussian_taps(sigma: f64) -> Vec<f32> {
    let radius = (4.0 * sigma).ceil() as i64;
    let raw: Vec<f64> = (-radius..=radius).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp()).collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|tap| (tap / sum) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blur_keeps_the_sum_and_adds_the_variance() {
        let mut spike = Grid::filled(41, 41, 0.0f32);
        spike[(20, 20)] = 1.0;
        let soft = blurred(&blurred(&spike, 1.2), 1.6);
        let (mut sum, mut variance) = (0.0, 0.0);
        for y in 0..41 {
            for x in 0..41 {
                sum += soft[(x, y)] as f64;
                variance += soft[(x, y)] as f64 * (x as f64 - 20.0).powi(2);
            }
        }
        assert!((sum - 1.0).abs() < 1e-4, "{sum}");
        assert!((variance - (1.2f64.powi(2) + 1.6f64.powi(2))).abs() < 0.02, "{variance}");
    }

    /// A blob drawn at a known place must be brightest at that place in every octave.
    #[test]
    fn octave_indices_map_back_to_the_image() {
        let (cx, cy) = (60.3, 47.8);
        let gray = Grid::from_fn(128, 96, |x, y| {
            let d_sq = (x as f64 + 0.5 - cx).powi(2) + (y as f64 + 0.5 - cy).powi(2);
            (-d_sq / 50.0).exp() as f32
        });
        for octave in octaves(&gray) {
            let level = &octave.levels[0];
            let total: f64 = level.as_slice().iter().map(|&v| v as f64).sum();
            let mut mean = (0.0, 0.0);
            for y in 0..level.height() {
                for x in 0..level.width() {
                    let share = level[(x, y)] as f64 / total;
                    mean.0 += share * octave.to_image(x as f64);
                    mean.1 += share * octave.to_image(y as f64);
                }
            }
            assert!((mean.0 - cx).abs() < 0.05 && (mean.1 - cy).abs() < 0.05, "step {}: {mean:?}", octave.step);
        }
    }
}
