//! What a camera sees past the edge of the table.
//!
//! Infinitely far away, hence without depth. Invariant: a function of the ray's direction only.

use super::light::equirect_uv;
use super::texels::Texels;
use glam::{Vec2, Vec3};
use std::sync::Arc;

/// What rays see that meet nothing.
pub enum Backdrop {
    /// One linear colour.
    Flat(Vec3),
    /// An equirectangular picture turned by an azimuth in turns, times a linear gain.
    Environment(Arc<Texels>, f32, f32),
    /// A picture hung at infinity around a direction, `spread` wide (tangent), times a linear gain.
    Photo {
        /// The picture.
        image: Arc<Texels>,
        /// Unit direction of its middle.
        towards: Vec3,
        /// Half of its width, as a tangent.
        spread: f32,
        /// Linear factor.
        gain: f32,
    },
}

impl Backdrop {
    /// The same backdrop times a linear factor.
    pub fn dimmed(self, factor: f32) -> Self {
        match self {
            Self::Flat(colour) => Self::Flat(colour * factor),
            Self::Environment(image, turn, gain) => Self::Environment(image, turn, gain * factor),
            Self::Photo { image, towards, spread, gain } => Self::Photo { image, towards, spread, gain: gain * factor },
        }
    }

    /// Linear light from a direction (any length).
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        match self {
            Self::Flat(colour) => *colour,
            Self::Environment(image, turn, gain) => {
                image.sample(equirect_uv(direction) + Vec2::new(*turn, 0.0), 0.0) * *gain
            }
            Self::Photo { image, towards, spread, gain } => {
                let right = towards.cross(Vec3::Z).normalize_or(Vec3::X);
                let down = towards.cross(right);
                let along = direction.dot(*towards).max(1e-3);
                let aspect = image.size().x / image.size().y;
                let uv = Vec2::new(direction.dot(right), direction.dot(down) * aspect) / (2.0 * spread * along) + 0.5;
                image.sample(uv, 1.0) * *gain
            }
        }
    }
}
