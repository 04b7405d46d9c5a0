//! Many small pictures on one page, to see a data set at a glance.
//!
//! Invariant: tiles keep their pixels; a sheet of `n` tiles in `c` columns has `ceil(n / c)` rows.

use surfel_core::Grid;

/// White space between tiles, pixels.
const GAP: usize = 4;

/// Lays tiles out row by row in `columns`; cells take the size of the largest tile, the page is white.
pub fn contact_sheet(tiles: &[Grid<[f32; 3]>], columns: usize) -> Grid<[f32; 3]> {
    let columns = columns.max(1);
    let cell_width = tiles.iter().map(Grid::width).max().unwrap_or(0) + GAP;
    let cell_height = tiles.iter().map(Grid::height).max().unwrap_or(0) + GAP;
    let rows = tiles.len().div_ceil(columns);
    let mut sheet = Grid::filled(columns * cell_width + GAP, rows * cell_height + GAP, [1.0; 3]);
    for (i, tile) in tiles.iter().enumerate() {
        let (x0, y0) = (GAP + i % columns * cell_width, GAP + i / columns * cell_height);
        for y in 0..tile.height() {
            for x in 0..tile.width() {
                sheet[(x0 + x, y0 + y)] = tile[(x, y)];
            }
        }
    }
    sheet
}

/// Depth as a picture: near is bright, far is dark, none is black; the range is the map's own.
pub fn depth_tile(depth: &Grid<f32>) -> Grid<[f32; 3]> {
    let known = depth.as_slice().iter().copied().filter(|d| *d > 0.0);
    let (near, far) = known.fold((f32::INFINITY, 0.0f32), |(a, b), d| (a.min(d), b.max(d)));
    // Inverse depth, because that is what disparity and the eye see.
    let (bright, dark) = (1.0 / near, 1.0 / far);
    depth.map(|&d| {
        if d <= 0.0 {
            return [0.0; 3];
        }
        [0.15 + 0.85 * (1.0 / d - dark) / (bright - dark).max(f32::MIN_POSITIVE); 3]
    })
}

/// Camera-frame normals as the usual picture: right is red, up is green, towards the camera is blue.
pub fn normal_tile(normal: &Grid<[f32; 3]>) -> Grid<[f32; 3]> {
    normal.map(|&[x, y, z]| {
        if [x, y, z] == [0.0; 3] {
            return [0.0; 3];
        }
        [0.5 + 0.5 * x, 0.5 - 0.5 * y, 0.5 - 0.5 * z]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_keep_their_pixels() {
        let tiles: Vec<_> = (0..3).map(|i| Grid::filled(5, 4, [i as f32 / 4.0; 3])).collect();
        let sheet = contact_sheet(&tiles, 2);
        assert_eq!((sheet.width(), sheet.height()), (2 * 9 + 4, 2 * 8 + 4));
        assert_eq!(sheet[(4 + 9, 4)], [0.25; 3]);
        assert_eq!(sheet[(4, 4 + 8)], [0.5; 3]);
        assert_eq!(sheet[(4 + 9, 4 + 8)], [1.0; 3]);
    }
}
