//! Depth, normals and masks at another size than they were stored in.
//!
//! Values of different surfaces are never mixed. Invariant: the depth map of a plane stays that of the same plane, where
//! it is interpolated; where it is not, each value is one that was stored.

use surfel_core::Grid;

/// Neighbouring depths that differ by more than this share belong to different surfaces (spec 6.2).
const SAME_SURFACE: f32 = 0.02;

/// The value of the nearest stored pixel, for maps that show the same picture.
pub(crate) fn nearest<T: Copy>(map: &Grid<T>, width: usize, height: usize) -> Grid<T> {
    let at = |i: usize, stored: usize, wanted: usize| ((2 * i + 1) * stored / (2 * wanted)).min(stored - 1);
    Grid::from_fn(width, height, |x, y| map[(at(x, map.width(), width), at(y, map.height(), height))])
}

/// Depth at `width` x `height` positions; `index` turns a column or row and the stored and wanted length into the
/// index coordinate in the stored map. 0 between surfaces and outside the stored pixel centres.
///
/// Inverse depth is interpolated, because that of a plane is linear in the image.
pub(crate) fn interpolated_depth(
    map: &Grid<f32>,
    (width, height): (usize, usize),
    index: impl Fn(usize, usize, usize) -> f64,
) -> Grid<f32> {
    let split = |i: usize, stored: usize, wanted: usize| {
        let at = index(i, stored, wanted);
        let inside = at >= 0.0 && at <= stored as f64 - 1.0;
        inside.then(|| {
            let low = (at as usize).min(stored.saturating_sub(2));
            (low, (low + 1).min(stored - 1), (at - low as f64) as f32)
        })
    };
    Grid::from_fn(width, height, |x, y| {
        let (Some((x0, x1, fx)), Some((y0, y1, fy))) = (split(x, map.width(), width), split(y, map.height(), height))
        else {
            return 0.0;
        };
        let corners = [
            ((x0, y0), (1.0 - fx) * (1.0 - fy)),
            ((x1, y0), fx * (1.0 - fy)),
            ((x0, y1), (1.0 - fx) * fy),
            ((x1, y1), fx * fy),
        ];
        let used = || corners.iter().filter(|(_, weight)| *weight > 0.0).map(|&(at, weight)| (map[at], weight));
        let (low, high) = used().fold((f32::INFINITY, 0.0f32), |(low, high), (z, _)| (low.min(z), high.max(z)));
        if !(low > 0.0 && high <= low * (1.0 + SAME_SURFACE)) {
            return 0.0;
        }
        used().map(|(z, weight)| weight / z).sum::<f32>().recip()
    })
}

/// Depth of the same picture at another size: interpolated when it grows, the nearest value when it shrinks.
pub(crate) fn depth_at_size(map: &Grid<f32>, width: usize, height: usize) -> Grid<f32> {
    if width <= map.width() && height <= map.height() {
        return nearest(map, width, height);
    }
    let centred = |i: usize, stored: usize, wanted: usize| (i as f64 + 0.5) * stored as f64 / wanted as f64 - 0.5;
    interpolated_depth(map, (width, height), centred)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(width: usize, height: usize) -> Grid<f32> {
        let at = |i: usize, n: usize| (i as f32 + 0.5) / n as f32;
        Grid::from_fn(width, height, |x, y| 1.0 / (0.4 + 0.04 * at(x, width) - 0.03 * at(y, height)))
    }

    #[test]
    fn a_plane_stays_a_plane_when_it_grows() {
        let (small, large) = (plane(20, 15), plane(80, 60));
        let grown = depth_at_size(&small, 80, 60);
        let known = grown.as_slice().iter().zip(large.as_slice()).filter(|(z, _)| **z > 0.0);
        // Beyond the outermost stored centres there is nothing.
        assert_eq!(known.clone().count(), 76 * 56);
        known.for_each(|(a, b)| assert!((a / b - 1.0).abs() < 1e-6, "{a} {b}"));
    }

    #[test]
    fn surfaces_are_never_mixed() {
        let step = Grid::from_fn(8, 4, |x, y| match (x, y) {
            (3, 2) => 0.0,
            (0..4, _) => 1.0,
            _ => 2.0,
        });
        let grown = depth_at_size(&step, 32, 16);
        assert!(grown.as_slice().iter().all(|z| [0.0, 1.0, 2.0].contains(z)));
        assert!([0.0, 1.0, 2.0].iter().all(|z| grown.as_slice().contains(z)));
        // Around the hole there is nothing, however close the next value.
        assert_eq!(grown[(14, 10)], 0.0);
        let shrunk = depth_at_size(&step, 4, 2);
        assert!(shrunk.as_slice().iter().all(|z| [0.0, 1.0, 2.0].contains(z)));
    }

    #[test]
    fn nearest_takes_the_pixel_under_the_centre() {
        let map = Grid::from_fn(6, 2, |x, y| 10 * y + x);
        assert_eq!(nearest(&map, 3, 1).into_vec(), [11, 13, 15]);
        assert_eq!(nearest(&map, 6, 2), map);
        assert_eq!(nearest(&map, 12, 2).row(0), [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]);
    }
}
