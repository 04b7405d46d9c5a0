//! Which surfels each tile has to look at, front to back (spec 3.3, 3.4).
//!
//! The depth-sorted surfels are cut into a fixed number of chunks, each binned on its own, so the lists keep
//! the order and are the same for any number of threads. Surfels over very many tiles stay in one shared
//! list, which bounds the memory.

use crate::bounds::PixelRect;
use crate::splat::Splat;
use rayon::prelude::*;

/// Pixels along one side of a tile.
pub(crate) const TILE: usize = 16;

/// A surfel over more tiles than this is kept once and looked at by every tile.
const MAX_COPIES: usize = 64;

/// Surfels per chunk, at least; and chunks, at most.
const MIN_CHUNK: usize = 4096;
const MAX_CHUNKS: usize = 32;

/// The tiling of an image.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TileGrid {
    pub columns: usize,
    pub rows: usize,
}

impl TileGrid {
    pub fn new(width: usize, height: usize) -> Self {
        Self { columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) }
    }

    pub fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// First pixel of tile `index`.
    pub fn corner(&self, index: usize) -> (usize, usize) {
        (index % self.columns * TILE, index / self.columns * TILE)
    }

    fn covered(&self, rect: &PixelRect) -> TileRect {
        let tile = TILE as u32;
        TileRect {
            columns: (rect.x0 / tile) as usize..rect.x1.div_ceil(tile) as usize,
            rows: (rect.y0 / tile) as usize..rect.y1.div_ceil(tile) as usize,
        }
    }
}

struct TileRect {
    columns: std::ops::Range<usize>,
    rows: std::ops::Range<usize>,
}

impl TileRect {
    fn is_wide(&self) -> bool {
        self.columns.len() * self.rows.len() > MAX_COPIES
    }

    fn tiles(&self, grid_columns: usize) -> impl Iterator<Item = usize> + '_ {
        self.rows.clone().flat_map(move |row| self.columns.clone().map(move |column| row * grid_columns + column))
    }
}

/// One chunk of the depth order, sorted into tiles: tile `t` has `surfels[starts[t]..starts[t + 1]]`.
struct Chunk {
    starts: Vec<u32>,
    surfels: Vec<u32>,
    wide: Vec<u32>,
}

/// The lists of all tiles.
pub(crate) struct TileLists {
    chunks: Vec<Chunk>,
    wide: Vec<u32>,
}

impl TileLists {
    /// Bins the surfels of `order`, near to far, by the rectangles of their splats.
    pub fn new(grid: TileGrid, splats: &[Splat], order: &[u32]) -> Self {
        let chunk_len = order.len().div_ceil(MAX_CHUNKS).max(MIN_CHUNK);
        let mut chunks: Vec<Chunk> =
            order.par_chunks(chunk_len).map(|surfels| Chunk::new(grid, splats, surfels)).collect();
        let wide = chunks.iter_mut().flat_map(|chunk| std::mem::take(&mut chunk.wide)).collect();
        Self { chunks, wide }
    }

    /// Surfels that tile `index` has to look at, near to far.
    pub fn surfels<'a>(&'a self, index: usize, splats: &'a [Splat]) -> impl Iterator<Item = u32> + 'a {
        let key = |surfel: u32| splats[surfel as usize].depth_key(surfel);
        let mut narrow = self.chunks.iter().flat_map(move |chunk| chunk.of_tile(index)).copied().peekable();
        let mut wide = self.wide.iter().copied().peekable();
        std::iter::from_fn(move || match (narrow.peek(), wide.peek()) {
            (Some(&a), Some(&b)) if key(b) < key(a) => wide.next(),
            (Some(_), _) => narrow.next(),
            (None, _) => wide.next(),
        })
    }
}

impl Chunk {
    fn new(grid: TileGrid, splats: &[Splat], order: &[u32]) -> Self {
        let mut starts = vec![0u32; grid.len() + 1];
        let mut wide = Vec::new();
        let covered: Vec<TileRect> = order.iter().map(|&surfel| grid.covered(&splats[surfel as usize].rect)).collect();
        for (&surfel, covered) in order.iter().zip(&covered) {
            if covered.is_wide() {
                wide.push(surfel);
                continue;
            }
            for tile in covered.tiles(grid.columns) {
                starts[tile + 1] += 1;
            }
        }
        for tile in 0..grid.len() {
            starts[tile + 1] += starts[tile];
        }
        let mut next = starts.clone();
        let mut surfels = vec![0u32; starts[grid.len()] as usize];
        for (&surfel, covered) in order.iter().zip(&covered).filter(|(_, covered)| !covered.is_wide()) {
            for tile in covered.tiles(grid.columns) {
                surfels[next[tile] as usize] = surfel;
                next[tile] += 1;
            }
        }
        Self { starts, surfels, wide }
    }

    fn of_tile(&self, index: usize) -> &[u32] {
        &self.surfels[self.starts[index] as usize..self.starts[index + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_hold_exactly_the_surfels_that_touch_a_tile_in_order() {
        let grid = TileGrid::new(333, 190);
        let splats: Vec<Splat> = (0..9000u32)
            .map(|i| {
                let (x0, y0) = (i * 7919 % 300, i * 104_729 % 180);
                let side = if i % 500 == 0 { 300 } else { 1 + i % 40 };
                let rect = PixelRect { x0, x1: (x0 + side).min(333), y0, y1: (y0 + side).min(190) };
                Splat { rect, z_centre: 1.0 + (i * 31 % 97) as f32, ..Splat::default() }
            })
            .collect();
        let mut order: Vec<u32> = (0..9000).collect();
        order.sort_by_key(|&i| splats[i as usize].depth_key(i));
        let lists = TileLists::new(grid, &splats, &order);
        assert!(!lists.wide.is_empty(), "the scene must exercise the shared list");
        for tile in 0..grid.len() {
            let (x, y) = grid.corner(tile);
            let touches = |&surfel: &u32| {
                let r = &splats[surfel as usize].rect;
                (r.x0 as usize) < x + TILE && r.x1 as usize > x && (r.y0 as usize) < y + TILE && r.y1 as usize > y
            };
            let expected: Vec<u32> = order.iter().copied().filter(touches).collect();
            let found: Vec<u32> = lists.surfels(tile, &splats).filter(touches).collect();
            assert_eq!(found, expected);
        }
    }
}
