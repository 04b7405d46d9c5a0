//! A surfel packed for the pixel loops: f32, counted from its own pixel, linear in `(x, y)`.
//!
//! With `k = x tw - tu`, `l = y tw - tv` the homogeneous hit `k x l` expands to
//! `x (tv x tw) + y (tw x tu) + tu x tv`: three multiply-adds per component. `z = det / g_z`, so inverse depth
//! is linear too. Invariant: every field is finite.

use crate::bounds::PixelRect;
use crate::pixel_camera::PixelCamera;
use crate::project::Projected;
use glam::{DVec2, DVec3};

#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Splat {
    /// Homogeneous hit per pixel column, per row, and at the origin; scaled so that the largest entry is 1.
    pub per_x: [f32; 3],
    pub per_y: [f32; 3],
    pub at_origin: [f32; 3],
    /// `z = depth_scale / g_z`, and its reciprocal.
    pub depth_scale: f32,
    pub inverse_depth_scale: f32,
    /// `z = z_slope . (u, v) + z_centre`.
    pub z_slope: [f32; 2],
    pub z_centre: f32,
    /// Low-pass centre from the origin.
    pub lowpass: [f32; 2],
    pub opacity: f32,
    pub colour: [f32; 3],
    pub normal: [f32; 3],
    /// Pixel from which the above counts.
    pub origin: [i32; 2],
    pub rect: PixelRect,
}

/// The linear form of a splat transform around a pixel, still in f64.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LinearForm {
    pub per_x: DVec3,
    pub per_y: DVec3,
    pub at_origin: DVec3,
    pub determinant: f64,
    /// What everything above has been multiplied by; drops out of `(u, v)` and `z`.
    pub scale: f64,
    pub origin: DVec2,
}

impl LinearForm {
    pub fn new(camera: &PixelCamera, projected: &Projected) -> Self {
        let size = DVec2::new(camera.width as f64, camera.height as f64);
        let footprint = &projected.footprint;
        let origin = footprint.lowpass_centre.round().clamp(DVec2::ZERO, size);
        let t = footprint.transform.relative_to(origin);
        let (per_x, per_y, at_origin) = (t.tv.cross(t.tw), t.tw.cross(t.tu), t.tu.cross(t.tv));
        let largest = [per_x, per_y, at_origin].iter().fold(0.0f64, |m, g| m.max(g.abs().max_element()));
        let scale = 1.0 / largest;
        Self {
            per_x: per_x * scale,
            per_y: per_y * scale,
            at_origin: at_origin * scale,
            determinant: t.tu.dot(per_x) * scale,
            scale,
            origin,
        }
    }
}

impl Splat {
    /// `None` when a number does not fit f32.
    pub fn new(
        camera: &PixelCamera,
        projected: &Projected,
        rect: PixelRect,
        opacity: f64,
        colour: [f64; 3],
    ) -> Option<Self> {
        let footprint = &projected.footprint;
        let form = LinearForm::new(camera, projected);
        let tw = footprint.transform.tw;
        let narrow = |v: DVec3| v.as_vec3().to_array();
        let splat = Self {
            per_x: narrow(form.per_x),
            per_y: narrow(form.per_y),
            at_origin: narrow(form.at_origin),
            depth_scale: form.determinant as f32,
            inverse_depth_scale: (1.0 / form.determinant) as f32,
            z_slope: [tw.x as f32, tw.y as f32],
            z_centre: tw.z as f32,
            lowpass: (footprint.lowpass_centre - form.origin).as_vec2().to_array(),
            opacity: opacity as f32,
            colour: colour.map(|c| c as f32),
            normal: narrow(projected.normal),
            origin: form.origin.as_ivec2().to_array(),
            rect,
        };
        splat.is_finite().then_some(splat)
    }

    /// Sorts by z-depth of the centre, then by index: bits of positive floats order like the floats.
    pub fn depth_key(&self, index: u32) -> u64 {
        u64::from(self.z_centre.to_bits()) << 32 | u64::from(index)
    }

    fn is_finite(&self) -> bool {
        let scalars = [
            self.depth_scale,
            self.inverse_depth_scale,
            self.z_slope[0],
            self.z_slope[1],
            self.z_centre,
            self.lowpass[0],
            self.lowpass[1],
            self.opacity,
        ];
        let vectors = [self.per_x, self.per_y, self.at_origin, self.colour, self.normal];
        scalars.iter().chain(vectors.iter().flatten()).all(|value| value.is_finite())
    }
}
