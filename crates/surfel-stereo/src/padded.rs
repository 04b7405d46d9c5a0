//! Pixels with a margin on every side, so that window kernels read without asking where the border is.
//!
//! Invariant: the margin holds one value, chosen so that a pixel outside the image contributes nothing.

use crate::vector::MAX_LANES;

/// A plane of `f32` pixels with `margin` more on every side; rows are padded for whole vectors.
pub struct Padded {
    /// Row-major values.
    pub data: Vec<f32>,
}

/// Where the pixels of planes of one size are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    /// Columns of the image.
    pub width: usize,
    /// Rows of the image.
    pub height: usize,
    /// Pixels around the image.
    pub margin: usize,
}

impl Layout {
    /// Distance between rows.
    pub fn stride(&self) -> usize {
        self.padded_width() + 2 * self.margin
    }

    /// Columns of the image, rounded up to whole vectors.
    pub fn padded_width(&self) -> usize {
        self.width.next_multiple_of(MAX_LANES)
    }

    /// Index of pixel `(x, y)` of the image.
    pub fn index(&self, x: usize, y: usize) -> usize {
        (y + self.margin) * self.stride() + x + self.margin
    }

    /// Distance from a pixel to the one `(dx, dy)` away.
    pub fn offset(&self, dx: isize, dy: isize) -> isize {
        dy * self.stride() as isize + dx
    }
}

impl Padded {
    /// A plane with `outside` around the pixels `inside(x, y)`.
    pub fn new(layout: Layout, outside: f32, mut inside: impl FnMut(usize, usize) -> f32) -> Self {
        let mut data = vec![outside; layout.stride() * (layout.height + 2 * layout.margin)];
        for y in 0..layout.height {
            let start = layout.index(0, y);
            for (x, value) in data[start..][..layout.width].iter_mut().enumerate() {
                *value = inside(x, y);
            }
        }
        Self { data }
    }
}
