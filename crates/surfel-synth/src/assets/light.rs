//! Light: an environment map folded to nine numbers per channel, and lamps with a size.
//!
//! Irradiance of a distant environment is a degree-2 polynomial of the normal to within a percent
//! (Ramamoorthi and Hanrahan 2001). Invariant: an environment of constant radiance 1 lights every normal by 1.

use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Diffuse light from everywhere, as a function of the normal.
#[derive(Clone, Debug, PartialEq)]
pub struct Irradiance {
    coefficients: [Vec3; 9],
}

/// Cosine-lobe factors of bands 0, 1, 2 divided by pi.
const BAND: [f32; 3] = [1.0, 2.0 / 3.0, 0.25];

fn basis(d: Vec3) -> [f32; 9] {
    let Vec3 { x, y, z } = d;
    [
        0.282_095,
        0.488_603 * y,
        0.488_603 * z,
        0.488_603 * x,
        1.092_548 * x * y,
        1.092_548 * y * z,
        0.315_392 * (3.0 * z * z - 1.0),
        1.092_548 * x * z,
        0.546_274 * (x * x - y * y),
    ]
}

impl Irradiance {
    /// Folds an equirectangular map of `width` columns, row-major linear radiance, top row up (+Z).
    pub fn from_equirect(width: usize, radiance: &[Vec3]) -> Self {
        let height = radiance.len() / width.max(1);
        let mut coefficients = [Vec3::ZERO; 9];
        let mut total = 0.0;
        for y in 0..height {
            let polar = (y as f32 + 0.5) / height as f32 * PI;
            let weight = polar.sin();
            for x in 0..width {
                let direction = equirect_direction(Vec2::new((x as f32 + 0.5) / width as f32, polar / PI));
                // One lamp in the map must not drown the rest: the lamps of a scene are drawn apart.
                let light = radiance[y * width + x].min(Vec3::splat(20.0));
                for (sum, b) in coefficients.iter_mut().zip(basis(direction)) {
                    *sum += light * (b * weight);
                }
                total += weight;
            }
        }
        for (i, c) in coefficients.iter_mut().enumerate() {
            let band = if i == 0 {
                0
            } else if i < 4 {
                1
            } else {
                2
            };
            *c *= 4.0 * PI / total * BAND[band];
        }
        Self { coefficients }
    }

    /// Light over pi on a surface with unit normal `n`; never negative.
    pub fn on(&self, n: Vec3) -> Vec3 {
        let sum: Vec3 = self.coefficients.iter().zip(basis(n)).map(|(c, b)| *c * b).sum();
        sum.max(Vec3::ZERO)
    }

    /// The same light times a factor.
    pub fn scaled(&self, factor: f32) -> Self {
        Self { coefficients: self.coefficients.map(|c| c * factor) }
    }

    /// Brightness on a surface facing up, mean of the channels.
    pub fn level(&self) -> f32 {
        self.on(Vec3::Z).element_sum() / 3.0
    }
}

/// Unit direction of equirectangular coordinates (u around from +X towards +Y, v from the zenith down).
pub fn equirect_direction(uv: Vec2) -> Vec3 {
    let (azimuth, polar) = (uv.x * TAU, uv.y * PI);
    Vec3::new(azimuth.cos() * polar.sin(), azimuth.sin() * polar.sin(), polar.cos())
}

/// Equirectangular coordinates of a direction.
pub fn equirect_uv(direction: Vec3) -> Vec2 {
    let d = direction.normalize_or(Vec3::Z);
    Vec2::new((d.y.atan2(d.x) / TAU).rem_euclid(1.0), d.z.clamp(-1.0, 1.0).acos() / PI)
}

/// A far lamp with a size, hence with soft shadows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Unit direction towards its middle, world frame.
    pub direction: Vec3,
    /// Half of the angle it fills, as a tangent.
    pub spread: f32,
    /// Linear light over pi on a surface facing it.
    pub colour: Vec3,
}

impl Lamp {
    /// Unit direction towards the `i`-th of `count` points spread evenly over the lamp, turned by `turn` radians.
    pub fn sample(&self, i: usize, count: usize, turn: f32) -> Vec3 {
        let (u, v) = self.direction.any_orthonormal_pair();
        let radius = self.spread * ((i as f32 + 0.5) / count as f32).sqrt();
        let angle = 2.399_963 * i as f32 + turn;
        (self.direction + u * (radius * angle.cos()) + v * (radius * angle.sin())).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_environment_lights_every_normal_equally() {
        let irradiance = Irradiance::from_equirect(64, &vec![Vec3::ONE; 64 * 32]);
        for n in [Vec3::X, Vec3::NEG_Z, Vec3::new(0.6, 0.0, 0.8)] {
            assert!((irradiance.on(n) - Vec3::ONE).length() < 0.01, "{}", irradiance.on(n));
        }
    }

    #[test]
    fn light_from_above_lights_what_faces_up() {
        let map: Vec<Vec3> = (0..64 * 32).map(|i| if i < 64 * 16 { Vec3::ONE } else { Vec3::ZERO }).collect();
        let irradiance = Irradiance::from_equirect(64, &map);
        // A half-lit sky: irradiance (1 + cos) / 2.
        assert!((irradiance.on(Vec3::Z).x - 1.0).abs() < 0.07);
        assert!((irradiance.on(Vec3::X).x - 0.5).abs() < 0.02);
        assert!(irradiance.on(Vec3::NEG_Z).x < 0.07);
    }

    #[test]
    fn equirect_coordinates_round_trip() {
        for uv in [Vec2::new(0.1, 0.3), Vec2::new(0.9, 0.7), Vec2::new(0.5, 0.5)] {
            let back = equirect_uv(equirect_direction(uv));
            assert!(((back - uv) - (back - uv).round()).length() < 1e-5, "{uv} {back}");
        }
    }
}
