//! A dense 2-D array of pixels: images, depth maps, normal maps, masks.
//!
//! Row-major, pixel `(x, y)` at `data[y * width + x]`, `(0, 0)` top left. The invariant is
//! `data.len() == width * height`.

/// A row-major image of `T`.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid<T> {
    width: usize,
    height: usize,
    data: Vec<T>,
}

impl<T> Grid<T> {
    /// Wraps row-major pixels.
    ///
    /// # Panics
    /// If `data.len() != width * height` (a programmer's error, not bad input).
    pub fn from_vec(width: usize, height: usize, data: Vec<T>) -> Self {
        assert_eq!(data.len(), width * height, "grid of {width}x{height} given {} pixels", data.len());
        Self { width, height, data }
    }

    /// Builds a grid by calling `pixel(x, y)` for every pixel, row by row.
    pub fn from_fn(width: usize, height: usize, mut pixel: impl FnMut(usize, usize) -> T) -> Self {
        let mut data = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                data.push(pixel(x, y));
            }
        }
        Self { width, height, data }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.data.len()
    }

    /// True for a grid without pixels.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// Left to right, as a mirror shows it.
    pub fn flipped(&self) -> Self
    where
        T: Copy,
    {
        Self::from_fn(self.width, self.height, |x, y| self[(self.width - 1 - x, y)])
    }

    /// All pixels, row-major.
    pub fn as_slice(&self) -> &[T] {
        &self.data
    }

    /// All pixels, row-major, mutable.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// The pixels, given away.
    pub fn into_vec(self) -> Vec<T> {
        self.data
    }

    /// One row of pixels.
    pub fn row(&self, y: usize) -> &[T] {
        &self.data[y * self.width..][..self.width]
    }

    /// Pixel `(x, y)` if it lies inside.
    pub fn get(&self, x: isize, y: isize) -> Option<&T> {
        let inside = x >= 0 && y >= 0 && (x as usize) < self.width && (y as usize) < self.height;
        inside.then(|| &self.data[y as usize * self.width + x as usize])
    }

    /// A grid of the same size with every pixel mapped.
    pub fn map<U>(&self, pixel: impl FnMut(&T) -> U) -> Grid<U> {
        Grid { width: self.width, height: self.height, data: self.data.iter().map(pixel).collect() }
    }

    /// True when the other grid has the same width and height.
    pub fn same_size<U>(&self, other: &Grid<U>) -> bool {
        self.width == other.width && self.height == other.height
    }
}

impl<T: Clone> Grid<T> {
    /// A grid with every pixel set to `value`.
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, data: vec![value; width * height] }
    }

    /// The rectangle with top-left pixel `(x0, y0)`.
    ///
    /// # Panics
    /// If the rectangle does not lie inside.
    pub fn cropped(&self, x0: usize, y0: usize, width: usize, height: usize) -> Self {
        assert!(x0 + width <= self.width && y0 + height <= self.height, "crop outside the grid");
        let data = (y0..y0 + height).flat_map(|y| self.row(y)[x0..x0 + width].iter().cloned()).collect();
        Self { width, height, data }
    }
}

impl<T> std::ops::Index<(usize, usize)> for Grid<T> {
    type Output = T;

    fn index(&self, (x, y): (usize, usize)) -> &T {
        debug_assert!(x < self.width);
        &self.data[y * self.width + x]
    }
}

impl<T> std::ops::IndexMut<(usize, usize)> for Grid<T> {
    fn index_mut(&mut self, (x, y): (usize, usize)) -> &mut T {
        debug_assert!(x < self.width);
        &mut self.data[y * self.width + x]
    }
}

impl Grid<f32> {
    /// Bilinear sample at *index* coordinates (pixel centres at integers); `None` outside the
    /// hull of the pixel centres.
    pub fn bilinear(&self, x: f64, y: f64) -> Option<f32> {
        let inside = x >= 0.0 && y >= 0.0 && x <= (self.width as f64 - 1.0) && y <= (self.height as f64 - 1.0);
        if !inside || self.is_empty() {
            return None;
        }
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let (fx, fy) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
        let top = self[(x0, y0)] * (1.0 - fx) + self[(x1, y0)] * fx;
        let bottom = self[(x0, y1)] * (1.0 - fx) + self[(x1, y1)] * fx;
        Some(top * (1.0 - fy) + bottom * fy)
    }
}
