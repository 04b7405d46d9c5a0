//! Where the ray of a pixel meets a surfel, and how much of the surfel that pixel sees (spec 3.2 to 3.4).
//!
//! The one f64 implementation: the twin evaluates it per pixel, the fast path derives its linear form from
//! it (`crate::splat`), and footprint regions of other crates ask [`Footprint::value`]. Invariant: a
//! footprint is never narrower than the pixel grid can see, whatever the slant of the surfel.

use crate::pixel_camera::PixelCamera;
use crate::quaternion;
use crate::slices::SurfelShape;
use glam::{DMat3, DVec2, DVec3};

/// The surfel-to-pixel homography: `(u, v)` projects to `x = tu.(u,v,1) / tw.(u,v,1)`, `y` likewise with `tv`,
/// at z-depth `tw.(u,v,1)`. `x, y` are index coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatTransform {
    /// Row of `x`, times depth.
    pub tu: DVec3,
    /// Row of `y`, times depth.
    pub tv: DVec3,
    /// Row of z-depth.
    pub tw: DVec3,
}

/// A pixel ray's meeting with a surfel's plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Position on the plane in standard deviations.
    pub u: f64,
    /// Position on the plane in standard deviations.
    pub v: f64,
    /// z-depth of the meeting.
    pub z: f64,
    /// Last component of the homogeneous `(u, v)`.
    pub g_z: f64,
    /// `u² + v²`.
    pub rho_surfel: f64,
    /// The same of the screen-space low-pass, a Gaussian of standard deviation `sqrt(1/2)` pixel.
    pub rho_lowpass: f64,
}

impl Hit {
    /// The smaller exponent wins: value is `exp(-rho / 2)`.
    pub fn rho(&self) -> f64 {
        if self.surfel_wins() { self.rho_surfel } else { self.rho_lowpass }
    }

    /// False where the low-pass defines the value.
    pub fn surfel_wins(&self) -> bool {
        self.rho_surfel <= self.rho_lowpass
    }
}

impl SplatTransform {
    /// From the surfel's tangent frame (columns of `world_from_surfel`) and its centre in the camera frame.
    pub fn new(camera: &PixelCamera, world_from_surfel: &DMat3, scales: DVec2, centre_in_camera: DVec3) -> Self {
        let rotation = camera.camera_from_world.rotation;
        let along_u = rotation * world_from_surfel.x_axis * scales.x;
        let along_v = rotation * world_from_surfel.y_axis * scales.y;
        let row = |axis: usize| DVec3::new(along_u[axis], along_v[axis], centre_in_camera[axis]);
        let tw = row(2);
        Self {
            tu: row(0) * camera.focal.x + tw * camera.principal.x,
            tv: row(1) * camera.focal.y + tw * camera.principal.y,
            tw,
        }
    }

    /// The same transform in pixel coordinates counted from `origin`.
    pub fn relative_to(&self, origin: DVec2) -> Self {
        Self { tu: self.tu - self.tw * origin.x, tv: self.tv - self.tw * origin.y, tw: self.tw }
    }

    /// Homogeneous `(u, v)` of the ray through index pixel `(x, y)`.
    pub fn homogeneous(&self, x: f64, y: f64) -> DVec3 {
        (self.tw * x - self.tu).cross(self.tw * y - self.tv)
    }

    /// Centre and half-extents (pixels) of the box around the disc of `cutoff` standard deviations; `None`
    /// when that disc reaches the camera plane and has no box (spec 3.3).
    pub fn bounds(&self, cutoff: f64) -> Option<(DVec2, DVec2)> {
        let signature = DVec3::new(cutoff * cutoff, cutoff * cutoff, -1.0);
        let distance = signature.dot(self.tw * self.tw);
        if distance >= 0.0 || !distance.is_finite() {
            return None;
        }
        let f = signature / distance;
        let centre = DVec2::new(f.dot(self.tu * self.tw), f.dot(self.tv * self.tw));
        let half_sq = centre * centre - DVec2::new(f.dot(self.tu * self.tu), f.dot(self.tv * self.tv));
        let half = half_sq.max(DVec2::splat(1e-4));
        Some((centre, DVec2::new(half.x.sqrt(), half.y.sqrt())))
    }
}

/// A surfel as one camera sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Surfel to pixel.
    pub transform: SplatTransform,
    /// Centre of the low-pass, index coordinates: the middle of the box of `cutoff` standard deviations.
    pub lowpass_centre: DVec2,
}

impl Footprint {
    /// `None` when the disc of `cutoff` standard deviations reaches the camera plane.
    pub fn new(transform: SplatTransform, cutoff: f64) -> Option<Self> {
        transform.bounds(cutoff).map(|(lowpass_centre, _)| Self { transform, lowpass_centre })
    }

    /// The footprint of a surfel; `None` when its centre is not beyond `near_clip`, when its disc reaches the
    /// camera plane, or when a number is not usable.
    pub fn of(camera: &PixelCamera, shape: &SurfelShape, near_clip: f64, cutoff: f64) -> Option<Self> {
        let (unit, _) = quaternion::normalise(shape.rotation)?;
        let centre = camera.camera_from_world.transform(shape.centre);
        if !(centre.z > near_clip && centre.is_finite() && shape.scales.min_element() > 0.0) {
            return None;
        }
        Self::new(SplatTransform::new(camera, &quaternion::to_matrix(unit), shape.scales, centre), cutoff)
    }

    /// Meeting of the ray through index pixel `(x, y)`; `None` when it runs parallel to the plane.
    pub fn hit(&self, x: f64, y: f64) -> Option<Hit> {
        let g = self.transform.homogeneous(x, y);
        if g.z == 0.0 {
            return None;
        }
        let (u, v) = (g.x / g.z, g.y / g.z);
        let z = self.transform.tw.dot(DVec3::new(u, v, 1.0));
        Some(Hit { u, v, z, g_z: g.z, rho_surfel: u * u + v * v, rho_lowpass: self.rho_lowpass(x, y) })
    }

    /// Value in (0, 1] that index pixel `(x, y)` sees, low-pass included, opacity not (paper: `G_k`).
    pub fn value(&self, x: f64, y: f64) -> f64 {
        let rho = self.hit(x, y).map_or_else(|| self.rho_lowpass(x, y), |hit| hit.rho());
        (-0.5 * rho).exp()
    }

    fn rho_lowpass(&self, x: f64, y: f64) -> f64 {
        2.0 * (self.lowpass_centre - DVec2::new(x, y)).length_squared()
    }
}
