//! A pinhole camera: intrinsics in pixels of a stated image size, and where it stands in the world.
//!
//! OpenCV axes (X right, Y down, Z forward). Intrinsics are *continuous*: the left edge of the
//! left-most pixel is 0 and its centre 0.5, so resizing multiplies and never shifts. Lens distortion
//! has been removed before a `Camera` exists (see [`crate::lens`]).

use crate::{Rigid, Similarity};
use glam::{DMat3, DVec2, DVec3};

/// Focal lengths and principal point in pixels, continuous coordinates (first pixel centre at 0.5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Horizontal focal length, pixels.
    pub fx: f64,
    /// Vertical focal length, pixels.
    pub fy: f64,
    /// Principal point, pixels from the left edge of the image.
    pub cx: f64,
    /// Principal point, pixels from the top edge of the image.
    pub cy: f64,
}

impl Intrinsics {
    /// From a calibration whose first pixel centre is (0, 0), as OpenCV writes it.
    pub fn from_index_coordinates(fx: f64, fy: f64, cx: f64, cy: f64) -> Self {
        Self { fx, fy, cx: cx + 0.5, cy: cy + 0.5 }
    }

    /// Principal point in index coordinates (first pixel centre at 0): what per-pixel loops use.
    pub fn principal_index(&self) -> DVec2 {
        DVec2::new(self.cx - 0.5, self.cy - 0.5)
    }

    /// `sqrt(fx fy)`, pixels: the focal length of the sampling rate (spec 1.9.3).
    pub fn mean_focal(&self) -> f64 {
        (self.fx * self.fy).sqrt()
    }
}

/// A pinhole camera in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Intrinsics in pixels of a `width` x `height` image.
    pub intrinsics: Intrinsics,
    /// Image columns.
    pub width: usize,
    /// Image rows.
    pub height: usize,
    /// World to camera, OpenCV axes, scene units.
    pub camera_from_world: Rigid,
}

impl Camera {
    /// The camera of the flipped picture in the mirrored world: `S camera_from_world S` with `S = diag(-1, 1, 1)`, and
    /// the principal point on the other side (spec 4.6).
    pub fn mirrored(&self) -> Self {
        let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        let mut mirrored = *self;
        mirrored.intrinsics.cx = self.width as f64 - self.intrinsics.cx;
        mirrored.camera_from_world = Rigid {
            rotation: mirror * self.camera_from_world.rotation * mirror,
            translation: mirror * self.camera_from_world.translation,
        };
        mirrored
    }

    /// Camera centre in the world.
    pub fn centre(&self) -> DVec3 {
        self.camera_from_world.inverse().translation
    }

    /// Unit viewing direction (the camera's +Z) in the world.
    pub fn forward(&self) -> DVec3 {
        self.camera_from_world.rotation.row(2)
    }

    /// Continuous pixel and z-depth of a world point; `None` on or behind the camera plane.
    pub fn project(&self, world: DVec3) -> Option<(DVec2, f64)> {
        let p = self.camera_from_world.transform(world);
        (p.z > 0.0).then(|| {
            let k = &self.intrinsics;
            (DVec2::new(k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy), p.z)
        })
    }

    /// Ray of a continuous pixel in the camera frame, with z = 1.
    pub fn ray(&self, pixel: DVec2) -> DVec3 {
        let k = &self.intrinsics;
        DVec3::new((pixel.x - k.cx) / k.fx, (pixel.y - k.cy) / k.fy, 1.0)
    }

    /// World point of a continuous pixel at z-depth `depth` (spec 1.1).
    pub fn unproject(&self, pixel: DVec2, depth: f64) -> DVec3 {
        self.camera_from_world.inverse().transform(self.ray(pixel) * depth)
    }

    /// Continuous pixel of pixel index `(x, y)`: its centre.
    pub fn pixel_centre(x: usize, y: usize) -> DVec2 {
        DVec2::new(x as f64 + 0.5, y as f64 + 0.5)
    }

    /// True when a continuous pixel lies inside the image.
    pub fn contains(&self, pixel: DVec2) -> bool {
        pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < self.width as f64 && pixel.y < self.height as f64
    }

    /// The camera of the same picture resampled to `width` x `height`.
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let (sx, sy) = (width as f64 / self.width as f64, height as f64 / self.height as f64);
        let k = self.intrinsics;
        let intrinsics = Intrinsics { fx: k.fx * sx, fy: k.fy * sy, cx: k.cx * sx, cy: k.cy * sy };
        Self { intrinsics, width, height, ..*self }
    }

    /// The camera of the rectangle with top-left pixel `(x0, y0)`; a negative corner pads.
    pub fn cropped(&self, x0: isize, y0: isize, width: usize, height: usize) -> Self {
        let k = self.intrinsics;
        let intrinsics = Intrinsics { cx: k.cx - x0 as f64, cy: k.cy - y0 as f64, ..k };
        Self { intrinsics, width, height, ..*self }
    }

    /// The camera turned where it stands: what it looked at along `d` (world frame) it now looks at along `turn * d`.
    pub fn turned(&self, turn: DMat3) -> Self {
        let rotation = self.camera_from_world.rotation * turn.transpose();
        Self { camera_from_world: Rigid { rotation, translation: -(rotation * self.centre()) }, ..*self }
    }

    /// The same camera seen from another world frame.
    pub fn in_frame(&self, new_from_world: &Similarity) -> Self {
        Self { camera_from_world: new_from_world.carry_camera(&self.camera_from_world), ..*self }
    }
}
