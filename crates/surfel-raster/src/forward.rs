//! Surfels to maps: project, sort by depth, bin into tiles, blend the tiles, write the maps (spec 3.1 to 3.5).
//!
//! Invariant: every step keeps a fixed order, so the maps are the same bits for any number of threads.

use crate::blend::{BlendConfig, BlendTile, Tile};
use crate::bounds::pixel_rect;
use crate::pixel_camera::PixelCamera;
use crate::project::project;
use crate::sh_colour;
use crate::splat::Splat;
use crate::tile::{TILE, TileGrid, TileLists};
use crate::{Maps, RasterError, RenderConfig, SurfelSlices};
use rayon::prelude::*;
use surfel_core::{Camera, Grid};

/// What [`crate::backward`] needs to remember of a rendering.
#[derive(Debug)]
pub struct Tape {
    pub(crate) camera: PixelCamera,
    pub(crate) config: RenderConfig,
    pub(crate) splats: Vec<Splat>,
    pub(crate) grid: TileGrid,
    pub(crate) tiles: Vec<Tile>,
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
    // A hidden surfel is the default splat, whose rectangle is empty.
    let splats: Vec<Splat> = (0..surfels.len())
        .into_par_iter()
        .map(|index| splat_of(surfels, index, &camera, config).unwrap_or_default())
        .collect();
    let grid = TileGrid::new(camera.width, camera.height);
    let lists = TileLists::new(grid, &splats, &depth_order(&splats));
    let blend = BlendConfig::new(config);
    let arch = pulp::Arch::new();
    let size = (camera.width, camera.height);
    let tiles: Vec<Tile> = (0..grid.len())
        .into_par_iter()
        .map(|index| {
            let (corner, surfels, splats) = (grid.corner(index), lists.surfels(index, &splats), splats.as_slice());
            arch.dispatch(BlendTile { corner, size, surfels, splats, config: blend })
        })
        .collect();
    let maps = write_maps(&tiles, grid, size, config.background);
    Ok((maps, Tape { camera, config: *config, splats, grid, tiles }))
}

/// Visible surfels from near to far.
pub(crate) fn depth_order(splats: &[Splat]) -> Vec<u32> {
    let visible = splats.iter().enumerate().filter(|(_, splat)| !splat.rect.is_empty());
    let mut keys: Vec<u64> = visible.map(|(index, splat)| splat.depth_key(index as u32)).collect();
    keys.par_sort_unstable();
    keys.into_iter().map(|key| key as u32).collect()
}

/// The splat of one surfel; `None` when it is broken or no pixel can see it.
fn splat_of(surfels: &SurfelSlices, index: usize, camera: &PixelCamera, config: &RenderConfig) -> Option<Splat> {
    let shape = surfels.shape(index);
    let projected = project(camera, config, &shape)?;
    let rect = pixel_rect(camera, config, &projected.footprint, shape.opacity)?;
    let mut coefficients = [[0.0; 3]; 16];
    let sh = surfels.sh_of(index);
    for (wide, narrow) in coefficients.iter_mut().zip(sh) {
        *wide = narrow.map(f64::from);
    }
    let colour = sh_colour::colour(&coefficients[..sh.len()], projected.direction)?;
    Splat::new(camera, &projected, rect, shape.opacity, colour)
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
