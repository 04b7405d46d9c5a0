//! One photograph with everything that must travel with it: pixels, camera and mask.
//!
//! Invariant: image, mask and camera have the same size. Every geometric edit (resize, crop, pad)
//! goes through the crate that reads photographs and changes all three together.

use crate::{Camera, Grid};

/// A posed, undistorted photograph at the working size.
#[derive(Clone, Debug)]
pub struct View {
    /// Image stem, used to name outputs.
    pub name: String,
    /// sRGB values in \[0, 1\] (not linearised), `[r, g, b]` per pixel.
    pub image: Grid<[f32; 3]>,
    /// True where the photograph shows the scene to reconstruct (inside the user's mask and inside the
    /// undistorted field of view).
    pub valid: Grid<bool>,
    /// The camera of `image`.
    pub camera: Camera,
}

impl View {
    /// A view whose every pixel is valid.
    pub fn new(name: impl Into<String>, image: Grid<[f32; 3]>, camera: Camera) -> Self {
        assert!(image.width() == camera.width && image.height() == camera.height, "image and camera differ in size");
        let valid = Grid::filled(image.width(), image.height(), true);
        Self { name: name.into(), image, valid, camera }
    }

    /// Luma in \[0, 1\] (Rec. 601 weights on sRGB values), for matching.
    pub fn gray(&self) -> Grid<f32> {
        self.image.map(|[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b)
    }
}
