//! Image textures with mip levels, sampled in linear light.
//!
//! Invariant: a sample at a level of detail averages about one pixel's footprint, so a texture seen from
//! afar neither sparkles nor moves between views.

use crate::texture::{linear_from_srgb, srgb_from_linear};
use glam::{Vec2, Vec3};
use std::sync::LazyLock;

/// An sRGB image as a pyramid of 8-bit levels, each half the size of the one before.
#[derive(Clone, Debug)]
pub struct Texels {
    levels: Vec<Level>,
}

#[derive(Clone, Debug)]
struct Level {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
}

static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|i| linear_from_srgb(i as f32 / 255.0)));

fn linear([r, g, b]: [u8; 3]) -> Vec3 {
    Vec3::new(LINEAR[r as usize], LINEAR[g as usize], LINEAR[b as usize])
}

impl Texels {
    /// Builds the pyramid of a decoded image.
    pub fn new(image: &image::DynamicImage) -> Self {
        let rgb = image.to_rgb8();
        let (width, height) = (rgb.width() as usize, rgb.height() as usize);
        let pixels = rgb.pixels().map(|p| p.0).collect();
        let mut levels = vec![Level { width: width.max(1), height: height.max(1), pixels }];
        if levels[0].pixels.is_empty() {
            levels[0].pixels.push([128; 3]);
        }
        while let Some(last) = levels.last().filter(|last| last.width > 1 || last.height > 1) {
            let half = last.halved();
            levels.push(half);
        }
        Self { levels }
    }

    /// Columns and rows of the finest level.
    pub fn size(&self) -> Vec2 {
        Vec2::new(self.levels[0].width as f32, self.levels[0].height as f32)
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        self.levels.iter().map(|level| 3 * level.pixels.len()).sum()
    }

    /// Linear colour averaged over the whole image.
    pub fn mean(&self) -> Vec3 {
        self.levels.last().map_or(Vec3::splat(0.2), |level| linear(level.pixels[0]))
    }

    /// Linear colour at texture coordinates `uv` ((0, 0) top left, repeating), trilinear at `log2_texels`:
    /// the logarithm of the number of finest texels across one pixel.
    pub fn sample(&self, uv: Vec2, log2_texels: f32) -> Vec3 {
        let top = (self.levels.len() - 1) as f32;
        let lod = if log2_texels.is_finite() { log2_texels.clamp(0.0, top) } else { 0.0 };
        let level = lod as usize;
        let fine = self.levels[level].bilinear(uv);
        let fraction = lod - level as f32;
        if fraction < 1e-3 { fine } else { fine.lerp(self.levels[level + 1].bilinear(uv), fraction) }
    }
}

impl Level {
    fn halved(&self) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mut pixels = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let columns = [2 * x, (2 * x + 1).min(self.width - 1)];
                let rows = [2 * y, (2 * y + 1).min(self.height - 1)];
                let sum: Vec3 = rows
                    .iter()
                    .flat_map(|&row| columns.iter().map(move |&column| (row, column)))
                    .map(|(row, column)| linear(self.pixels[row * self.width + column]))
                    .sum();
                pixels.push((sum / 4.0).to_array().map(|c| (255.0 * srgb_from_linear(c) + 0.5) as u8));
            }
        }
        Self { width, height, pixels }
    }

    fn bilinear(&self, uv: Vec2) -> Vec3 {
        let x = (uv.x - uv.x.floor()) * self.width as f32 - 0.5;
        let y = (uv.y - uv.y.floor()) * self.height as f32 - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (s, t) = (x - x0, y - y0);
        let wrap = |v: f32, size: usize| (v as isize).rem_euclid(size as isize) as usize;
        let columns = [wrap(x0, self.width), wrap(x0 + 1.0, self.width)];
        let rows = [wrap(y0, self.height), wrap(y0 + 1.0, self.height)];
        let at = |i: usize, j: usize| linear(self.pixels[rows[j] * self.width + columns[i]]);
        at(0, 0).lerp(at(1, 0), s).lerp(at(0, 1).lerp(at(1, 1), s), t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checker() -> Texels {
        let picture = image::RgbImage::from_fn(8, 8, |x, y| image::Rgb([if (x + y) % 2 == 0 { 255 } else { 0 }; 3]));
        Texels::new(&picture.into())
    }

    #[test]
    fn texel_centres_are_exact_and_coordinates_repeat() {
        let texels = checker();
        let white = texels.sample(Vec2::splat(0.5 / 8.0), 0.0);
        assert!((white - Vec3::ONE).length() < 1e-6);
        let black = texels.sample(Vec2::new(1.5 / 8.0 - 3.0, 0.5 / 8.0 + 2.0), 0.0);
        assert!(black.length() < 1e-3);
    }

    #[test]
    fn far_away_a_checker_is_half_as_bright() {
        let texels = checker();
        for lod in [1.0, 1.7, 3.0, 40.0] {
            let grey = texels.sample(Vec2::new(0.3, 0.8), lod);
            assert!((grey - Vec3::splat(0.5)).length() < 0.01, "{grey} at {lod}");
        }
    }
}
