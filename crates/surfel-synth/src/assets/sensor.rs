//! From linear light to the file a camera writes: exposure, sharpening, noise, sRGB, eight bits, JPEG.
//!
//! Invariant: touches colours only; the same sensor and seed give the same picture.

use crate::random::Random;
use crate::texture::srgb_from_linear;
use glam::Vec3;
use surfel_core::Grid;

/// How one photograph was recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensor {
    /// Linear gain per channel: exposure and white balance.
    pub gain: Vec3,
    /// Standard deviation of the read noise, linear units.
    pub read_noise: f32,
    /// Shot noise: variance per unit of linear light.
    pub shot_noise: f32,
    /// Light lost in the corners, 0 to 1.
    pub vignetting: f32,
    /// How far the picture is pushed away from its 3 x 3 mean, as a camera's processor does; 0 = as it was.
    pub sharpening: f32,
    /// Quality of the JPEG file, 1 to 100; `None` for a lossless one.
    pub jpeg_quality: Option<u8>,
    /// Names the noise.
    pub seed: u64,
}

impl Default for Sensor {
    fn default() -> Self {
        Self {
            gain: Vec3::ONE,
            read_noise: 0.0,
            shot_noise: 0.0,
            vignetting: 0.0,
            sharpening: 0.0,
            jpeg_quality: None,
            seed: 0,
        }
    }
}

impl Sensor {
    /// sRGB values in \[0, 1\] (multiples of 1/255) of linear light.
    pub fn record(&self, light: &Grid<[f32; 3]>) -> Grid<[f32; 3]> {
        let (width, height) = (light.width(), light.height());
        let sharpened = (self.sharpening > 0.0).then(|| sharpened(light, self.sharpening));
        let light = sharpened.as_ref().unwrap_or(light);
        let mut random = Random::new(self.seed);
        let half_diagonal_sq = 0.25 * (width * width + height * height) as f32;
        let mut bytes = Vec::with_capacity(3 * light.len());
        for y in 0..height {
            for x in 0..width {
                let (dx, dy) = (x as f32 + 0.5 - 0.5 * width as f32, y as f32 + 0.5 - 0.5 * height as f32);
                let shade = 1.0 - self.vignetting * (dx * dx + dy * dy) / half_diagonal_sq;
                for (value, gain) in light[(x, y)].iter().zip(self.gain.to_array()) {
                    let clean = value * gain * shade;
                    let variance = self.read_noise * self.read_noise + self.shot_noise * clean.max(0.0);
                    let noise = if variance > 0.0 { variance.sqrt() * random.normal() as f32 } else { 0.0 };
                    bytes.push((255.0 * srgb_from_linear(clean + noise) + 0.5) as u8);
                }
            }
        }
        if let Some(quality) = self.jpeg_quality {
            bytes = through_jpeg(bytes, width, height, quality);
        }
        let pixels = bytes.chunks_exact(3).map(|p| [p[0], p[1], p[2]].map(|v| f32::from(v) / 255.0)).collect();
        Grid::from_vec(width, height, pixels)
    }
}

/// `light` and `amount` times its difference from the mean of its 3 x 3 neighbourhood; light is never negative.
fn sharpened(light: &Grid<[f32; 3]>, amount: f32) -> Grid<[f32; 3]> {
    let (width, height) = (light.width(), light.height());
    Grid::from_fn(width, height, |x, y| {
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        let around = (y.saturating_sub(1)..(y + 2).min(height)).flat_map(|y| columns.clone().map(move |x| (x, y)));
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for at in around {
            sum += Vec3::from(light[at]);
            count += 1.0;
        }
        let here = Vec3::from(light[(x, y)]);
        (here + amount * (here - sum / count)).max(Vec3::ZERO).to_array()
    })
}

/// Encodes and decodes; the picture as it was when the codec cannot take its size.
fn through_jpeg(bytes: Vec<u8>, width: usize, height: usize, quality: u8) -> Vec<u8> {
    let mut file = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut file, quality.clamp(1, 100));
    let encoded =
        image::ImageEncoder::write_image(encoder, &bytes, width as u32, height as u32, image::ExtendedColorType::Rgb8);
    let decoded = encoded.and_then(|()| image::load_from_memory_with_format(&file, image::ImageFormat::Jpeg));
    decoded.map_or(bytes, |picture| picture.into_rgb8().into_raw())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Grid<[f32; 3]> {
        Grid::from_fn(64, 48, |x, y| [x as f32 / 64.0, y as f32 / 48.0, 0.3])
    }

    #[test]
    fn a_perfect_sensor_only_rounds_to_bytes() {
        let recorded = Sensor::default().record(&ramp());
        for (a, b) in ramp().as_slice().iter().zip(recorded.as_slice()) {
            assert!((0..3).all(|c| (srgb_from_linear(a[c]) - b[c]).abs() <= 0.5 / 255.0 + 1e-6));
        }
    }

    #[test]
    fn sharpening_steepens_an_edge_and_leaves_flat_light_alone() {
        let edge = Grid::from_fn(16, 8, |x, _| [if x < 8 { 0.2 } else { 0.6 }; 3]);
        let sharp = sharpened(&edge, 0.5);
        assert!((sharp[(2, 4)][0] - edge[(2, 4)][0]).abs() < 1e-6, "{:?}", sharp[(2, 4)]);
        assert!(sharp[(7, 4)][0] < 0.19 && sharp[(8, 4)][0] > 0.61, "{:?} {:?}", sharp[(7, 4)], sharp[(8, 4)]);
    }

    #[test]
    fn defects_change_the_picture_a_little_and_repeatably() {
        let sensor =
            Sensor { read_noise: 0.01, shot_noise: 1e-4, jpeg_quality: Some(85), seed: 4, ..Sensor::default() };
        let (clean, noisy) = (Sensor::default().record(&ramp()), sensor.record(&ramp()));
        assert_eq!(noisy, sensor.record(&ramp()));
        let error = clean.as_slice().iter().zip(noisy.as_slice()).map(|(a, b)| (a[0] - b[0]).abs()).sum::<f32>();
        let mean = error / clean.len() as f32;
        assert!(mean > 0.002 && mean < 0.05, "{mean}");
    }
}
