//! Procedural albedo: a colour for every point of space.
//!
//! A texture is solid, in the sense of marble: it is evaluated at a 3-D point and needs no
//! parametrisation. Invariant: a pure function of the point, so every view sees the same paint.

use crate::noise::fractal_noise;
use glam::{DVec3, Vec3};

/// Which coordinates of a surface point a texture reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TextureSpace {
    /// Those of the object: the paint moves with it.
    #[default]
    Surface,
    /// Those of the world.
    World,
}

/// Albedo as a function of a 3-D point, sRGB in \[0, 1\].
#[derive(Clone, Debug, PartialEq)]
pub enum Texture {
    /// One colour.
    Solid([f32; 3]),
    /// Cubes of two colours.
    Checker {
        /// Edge of a cube, scene units.
        size: f64,
        /// The two colours, sRGB.
        colours: [[f32; 3]; 2],
    },
    /// Multi-octave value noise between two colours, with independent noise in brightness.
    Noise {
        /// Names the pattern.
        seed: u64,
        /// Size of the largest blotches, scene units; each octave halves it.
        size: f64,
        /// Number of octaves. For matching, the last should be near two pixels wide.
        octaves: u32,
        /// The two colours, sRGB.
        colours: [[f32; 3]; 2],
    },
}

/// How much of its amplitude each octave of noise keeps; 0.7 leaves fine detail strong enough to match on.
const OCTAVE_GAIN: f64 = 0.7;

impl Texture {
    /// sRGB colour in \[0, 1\] at `point`, scene units.
    pub fn colour(&self, point: DVec3) -> Vec3 {
        match self {
            Self::Solid(colour) => Vec3::from(*colour),
            Self::Checker { size, colours } => {
                let cell = (point / *size).floor();
                let odd = (cell.x + cell.y + cell.z).rem_euclid(2.0) as usize;
                Vec3::from(colours[odd.min(1)])
            }
            Self::Noise { seed, size, octaves, colours } => {
                let p = point / *size;
                let hue = fractal_noise(*seed, p, *octaves, OCTAVE_GAIN) as f32;
                let brightness = fractal_noise(seed ^ 0xb1, p * 1.37, *octaves, OCTAVE_GAIN) as f32;
                let base = Vec3::from(colours[0]).lerp(Vec3::from(colours[1]), hue);
                (base * (0.45 + 1.1 * brightness)).clamp(Vec3::ZERO, Vec3::ONE)
            }
        }
    }
}

/// Linear light of an sRGB value in \[0, 1\] (IEC 61966-2-1).
pub fn linear_from_srgb(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// sRGB value in \[0, 1\] of linear light, clipped like a sensor.
pub fn srgb_from_linear(value: f32) -> f32 {
    let v = value.clamp(0.0, 1.0);
    if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checker_alternates_on_every_axis() {
        let checker = Texture::Checker { size: 2.0, colours: [[0.0; 3], [1.0; 3]] };
        let here = checker.colour(DVec3::splat(0.5));
        for step in [DVec3::X, DVec3::Y, DVec3::NEG_Z] {
            assert_ne!(checker.colour(DVec3::splat(0.5) + step * 2.0), here);
            assert_eq!(checker.colour(DVec3::splat(0.5) + step * 4.0), here);
        }
    }

    #[test]
    fn srgb_round_trips() {
        for i in 0..=100 {
            let v = i as f32 / 100.0;
            assert!((srgb_from_linear(linear_from_srgb(v)) - v).abs() < 1e-5);
        }
    }
}
