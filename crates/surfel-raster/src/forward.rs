//! Surfels to maps: project, sort by depth, bin into tiles, blend the tiles, write the maps (spec 3.1 to 3.5).
//!
//! Invariant: every step keeps a fixed order, so the maps are the same bits for any number of threads.

use crate::blend::{BlendConfig, BlendTile, Tile};
use crate::pixel_camera::PixelCamera;
use crate::project::project;
use crate::sh_colour;
use crate::splat::Splat;
use crate::tile::{TILE, TileGrid, TileLists};
use crate::{Maps, RasterError, RenderConfig, SurfelSlices};
use rayon::prelude::*;
use surfel_core::{Camera, Grid};

/// What [`crate::backward`] needs to remember of a rendering.
pub struct Tape {
    pub(crate) camera: PixelCamera,
    pub(crate) config: RenderConfig,
    pub(crate) num_surfels: usize,
    pub(crate) sorted: Sorted,
    pub(crate) grid: TileGrid,
    pub(crate) tiles: Vec<Tile>,
}

/// Visible splats, near to far.
pub(crate) struct Sorted {
    /// Surfel of each rank.
    pub surfel_of_rank: Vec<u32>,
    pub splats: Vec<Splat>,
}

/// Renders a surfel set; the maps alone.
///
/// Surfels that are broken (a number that is not finite, a zero quaternion, a scale that is not positive), behind
/// `near_clip`, seen exactly edge-on or reaching the camera plane are skipped.
///
/// # Errors
/// [`RasterError`] for arrays that disagree, a camera that cannot project, or a setting out of range.
pub fn render(surfels: &SurfelSlices, camera: &Camera, config: &RenderConfig) -> Result<Maps, RasterError> {
    forward(surfels, camera, config).map(|(maps, _)| maps)
}

/// Renders a surfel set and keeps what [`crate::backward`] needs.
///
/// # Errors
/// As [`render`].
pub fn forward(surfels: &SurfelSlices, camera: &Camera, config: &RenderConfig) -> Result<(Maps, Tape), RasterError> {
    surfels.validate()?;
    config.validate()?;
    let camera = PixelCamera::new(camera)?;
    let sorted = Sorted::new(surfels, &camera, config);
    let grid = TileGrid::new(camera.width, camera.height);
    let rects: Vec<_> = sorted.splats.iter().map(|splat| splat.rect).collect();
    let lists = TileLists::new(grid, &rects);
    let blend = BlendConfig::new(config);
    let arch = pulp::Arch::new();
    let size = (camera.width, camera.height);
    let tiles: Vec<Tile> = (0..grid.len())
        .into_par_iter()
        .map(|t| {
            let (corner, ranks, splats) = (grid.corner(t), lists.ranks(t), sorted.splats.as_slice());
            arch.dispatch(BlendTile { corner, size, ranks, splats, config: blend })
        })
        .collect();
    let maps = write_maps(&tiles, grid, size, config.background);
    Ok((maps, Tape { camera, config: *config, num_surfels: surfels.len(), sorted, grid, tiles }))
}

impl Sorted {
    fn new(surfels: &SurfelSlices, camera: &PixelCamera, config: &RenderConfig) -> Self {
        let splats: Vec<Option<(u64, Splat)>> =
            (0..surfels.len()).into_par_iter().map(|index| splat_of(surfels, index, camera, config)).collect();
        let mut order: Vec<u64> = splats.iter().flatten().map(|(key, _)| *key).collect();
        order.par_sort_unstable();
        let surfel_of_rank: Vec<u32> = order.par_iter().map(|&key| key as u32).collect();
        let splats = surfel_of_rank.par_iter().filter_map(|&k| splats[k as usize].as_ref()).map(|(_, s)| *s).collect();
        Self { surfel_of_rank, splats }
    }
}

/// The splat of one surfel with its sorting key: depth above, index below, so equal depths keep their order.
fn splat_of(surfels: &SurfelSlices, index: usize, camera: &PixelCamera, config: &RenderConfig) -> Option<(u64, Splat)> {
    let shape = surfels.shape(index);
    let projected = project(camera, config, &shape)?;
    let mut coefficients = [[0.0; 3]; 16];
    let sh = surfels.sh_of(index);
    for (wide, narrow) in coefficients.iter_mut().zip(sh) {
        *wide = narrow.map(f64::from);
    }
    let colour = sh_colour::colour(&coefficients[..sh.len()], projected.direction);
    let splat = Splat::new(camera, config, &projected, shape.opacity, colour)?;
    // Bits of positive floats sort like the floats.
    let key = u64::from(projected.depth_key().to_bits()) << 32 | index as u64;
    Some((key, splat))
}

fn write_maps(tiles: &[Tile], grid: TileGrid, (width, height): (usize, usize), background: [f32; 3]) -> Maps {
    fn gather<T: Send>(
        tiles: &[Tile],
        grid: TileGrid,
        (width, height): (usize, usize),
        pixel: impl Fn(&crate::blend::Row, usize) -> T + Sync,
    ) -> Grid<T> {
        let pixel = &pixel;
        let pixels = (0..height)
            .into_par_iter()
            .flat_map_iter(|y| {
                (0..width).map(move |x| {
                    let tile = &tiles[y / TILE * grid.columns + x / TILE];
                    pixel(&tile.rows[y % TILE], x % TILE)
                })
            })
            .collect();
        Grid::from_vec(width, height, pixels)
    }
    let size = (width, height);
    Maps {
        colour: gather(tiles, grid, size, |row, lane| {
            std::array::from_fn(|c| row.colour[c][lane] + row.transmittance[lane] * background[c])
        }),
        alpha: gather(tiles, grid, size, |row, lane| 1.0 - row.transmittance[lane]),
        depth_sum: gather(tiles, grid, size, |row, lane| row.depth[lane]),
        depth_expected: gather(tiles, grid, size, |row, lane| {
            let alpha = 1.0 - row.transmittance[lane];
            if alpha > 0.0 { row.depth[lane] / alpha } else { 0.0 }
        }),
        depth_median: gather(tiles, grid, size, |row, lane| row.median[lane]),
        normal: gather(tiles, grid, size, |row, lane| std::array::from_fn(|c| row.normal[c][lane])),
        distortion: gather(tiles, grid, size, |row, lane| row.distortion[lane]),
        num_contributors: gather(tiles, grid, size, |row, lane| row.num_blended[lane]),
    }
}
