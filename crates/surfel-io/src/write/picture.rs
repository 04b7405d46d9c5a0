//! A canvas of sRGB floats: panels with round corners, strokes, and the final bytes.
//!
//! Invariant: everything is drawn by coverage in \[0, 1\] and clipped at the border.

use glam::Vec2;
use surfel_core::Grid;

/// The canvas.
pub(super) struct Picture(Grid<[f32; 3]>);

impl Picture {
    /// A canvas of one colour.
    pub(super) fn new(width: usize, height: usize, colour: [f32; 3]) -> Self {
        Self(Grid::filled(width, height, colour))
    }

    /// Width and height, pixels.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.0.width(), self.0.height())
    }

    /// Pastes a picture with its top-left corner at `(x0, y0)`, corners rounded by `radius` pixels.
    pub(super) fn paste(&mut self, panel: &Grid<[f32; 3]>, (x0, y0): (usize, usize), radius: f32) {
        let half = Vec2::new(panel.width() as f32, panel.height() as f32) / 2.0;
        let radius = radius.min(half.min_element());
        for y in 0..panel.height() {
            for x in 0..panel.width() {
                let from_corner = (Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - half).abs() - half + radius;
                let coverage = radius + 0.5 - from_corner.max(Vec2::ZERO).length();
                self.blend((x0 + x) as isize, (y0 + y) as isize, panel[(x, y)], coverage.clamp(0.0, 1.0));
            }
        }
    }

    /// Draws an open line through `points` (pixels, y down) with round ends; each pixel is painted once.
    pub(super) fn stroke(&mut self, points: &[Vec2], weight: f32, colour: [f32; 3]) {
        let (Some(low), Some(high)) =
            (points.iter().copied().reduce(Vec2::min), points.iter().copied().reduce(Vec2::max))
        else {
            return;
        };
        let reach = weight / 2.0 + 1.0;
        for y in (low.y - reach).floor() as isize..=(high.y + reach).ceil() as isize {
            for x in (low.x - reach).floor() as isize..=(high.x + reach).ceil() as isize {
                let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let nearest = points.windows(2).map(|ends| distance(centre, ends[0], ends[1])).fold(f32::MAX, f32::min);
                self.blend(x, y, colour, (weight / 2.0 + 0.5 - nearest).clamp(0.0, 1.0));
            }
        }
    }

    fn blend(&mut self, x: isize, y: isize, colour: [f32; 3], coverage: f32) {
        if coverage > 0.0 && self.0.get(x, y).is_some() {
            let pixel = &mut self.0[(x as usize, y as usize)];
            *pixel = std::array::from_fn(|i| pixel[i] + coverage * (colour[i] - pixel[i]));
        }
    }

    /// Row-major 8-bit RGB.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        self.0.as_slice().iter().flatten().map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8).collect()
    }
}

/// Distance of a point to a segment, which may be a single point.
fn distance(point: Vec2, from: Vec2, to: Vec2) -> f32 {
    let along = to - from;
    let t = ((point - from).dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    point.distance(from + along * t)
}

/// Mean colour over the area of each new pixel: exact when shrinking, crisp when enlarging.
pub(super) fn resampled(source: &Grid<[f32; 3]>, width: usize, height: usize) -> Grid<[f32; 3]> {
    let columns = overlaps(source.width(), width);
    let rows = overlaps(source.height(), height);
    Grid::from_fn(width, height, |x, y| {
        let mut sum = [0.0; 3];
        for &(source_y, weight_y) in &rows[y] {
            for &(source_x, weight_x) in &columns[x] {
                let pixel = source[(source_x, source_y)];
                sum = std::array::from_fn(|i| sum[i] + weight_x * weight_y * pixel[i]);
            }
        }
        sum
    })
}

/// Source indices under each target cell, with weights that sum to 1.
fn overlaps(source: usize, target: usize) -> Vec<Vec<(usize, f32)>> {
    let step = source as f64 / target as f64;
    let cell = |i: usize| {
        let (start, end) = (i as f64 * step, (i + 1) as f64 * step);
        let covered = |s: usize| ((s as f64 + 1.0).min(end) - (s as f64).max(start)).max(0.0);
        let indices = start as usize..(end.ceil() as usize).min(source);
        indices.map(|s| (s, (covered(s) / step) as f32)).collect()
    };
    (0..target).map(cell).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resampling_keeps_the_mean() {
        let source = Grid::from_fn(13, 7, |x, y| [(x * 7 % 5) as f32, y as f32, 1.0]);
        for (width, height) in [(5, 3), (13, 7), (40, 21)] {
            let mean =
                |grid: &Grid<[f32; 3]>, i: usize| grid.as_slice().iter().map(|p| p[i]).sum::<f32>() / grid.len() as f32;
            let scaled = resampled(&source, width, height);
            assert!((0..3).all(|i| (mean(&scaled, i) - mean(&source, i)).abs() < 1e-4));
        }
    }
}
