//! The rectangle of pixels a surfel is offered to (spec 3.3).
//!
//! Invariant in [`BoundingBox::AlphaAware`]: outside the rectangle alpha is below 1/255, so cutting there
//! changes no pixel.

use crate::config::{BoundingBox, MIN_ALPHA, RenderConfig};
use crate::pixel_camera::PixelCamera;
use crate::ray_splat::Footprint;
use glam::DVec2;

/// Half-open rectangle of pixel indices, inside the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelRect {
    /// First column.
    pub x0: u32,
    /// One past the last column.
    pub x1: u32,
    /// First row.
    pub y0: u32,
    /// One past the last row.
    pub y1: u32,
}

impl PixelRect {
    /// True when it holds no pixel.
    pub fn is_empty(&self) -> bool {
        self.x0 >= self.x1 || self.y0 >= self.y1
    }
}

/// Side of the reference rasterizer's tiles, pixels.
const REFERENCE_TILE: f64 = 16.0;

/// Covers the rounding of the f32 pixel loops, pixels.
const SLACK: f64 = 1e-2;

/// Pixels in which a surfel may show; `None` when there are none.
pub fn pixel_rect(
    camera: &PixelCamera,
    config: &RenderConfig,
    footprint: &Footprint,
    opacity: f64,
) -> Option<PixelRect> {
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    let (low, high) = match config.bounding_box {
        BoundingBox::AlphaAware => alpha_aware(footprint, opacity, size)?,
        BoundingBox::Reference => reference(footprint, config.cutoff)?,
    };
    let (low, high) = (low.clamp(DVec2::ZERO, size), high.clamp(DVec2::ZERO, size));
    let rect = PixelRect { x0: low.x as u32, x1: high.x as u32, y0: low.y as u32, y1: high.y as u32 };
    (!rect.is_empty()).then_some(rect)
}

fn alpha_aware(footprint: &Footprint, opacity: f64, size: DVec2) -> Option<(DVec2, DVec2)> {
    if opacity < MIN_ALPHA {
        return None;
    }
    let cutoff = (2.0 * (opacity / MIN_ALPHA).ln()).sqrt();
    let lowpass_reach = DVec2::splat(cutoff * std::f64::consts::FRAC_1_SQRT_2);
    // A disc that reaches the camera plane only beyond the low-pass cutoff has no box: offer it everywhere.
    let Some((centre, half)) = footprint.transform.bounds(cutoff) else { return Some((DVec2::ZERO, size)) };
    let low = (centre - half).min(footprint.lowpass_centre - lowpass_reach) - SLACK;
    let high = (centre + half).max(footprint.lowpass_centre + lowpass_reach) + SLACK;
    Some((low.ceil(), high.floor() + 1.0))
}

fn reference(footprint: &Footprint, cutoff: f64) -> Option<(DVec2, DVec2)> {
    let (centre, half) = footprint.transform.bounds(cutoff)?;
    let radius = half.max_element().max(cutoff * std::f64::consts::FRAC_1_SQRT_2).ceil();
    let low = ((centre - radius) / REFERENCE_TILE).trunc();
    let high = ((centre + radius + (REFERENCE_TILE - 1.0)) / REFERENCE_TILE).trunc();
    Some((low * REFERENCE_TILE, high * REFERENCE_TILE))
}
