//! Front-to-back blending of one tile, a row of pixels at a time (spec 3.4).
//!
//! The lanes of every loop are the pixels of a row; the loops hold no branch and no call, so they vectorise
//! for whatever machine [`pulp`] finds. Depths enter the distortion as differences to the tile's first
//! splat, which leaves the map unchanged and keeps f32 from cancelling. Invariant: a lane that is not hit
//! adds exact zeros.

use crate::config::{MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE, RenderConfig};
use crate::exp::exp_neg;
use crate::splat::Splat;
use crate::tile::TILE;
use pulp::{Simd, WithSimd};

/// Pixels of one row of a tile.
pub(crate) type Lanes = [f32; TILE];

/// [`RenderConfig`] as the pixel loops want it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlendConfig {
    pub near_clip: f32,
    /// `K` of `m = const - K / z`.
    pub distortion_factor: f32,
    pub centre_depth_when_lowpass: bool,
}

impl BlendConfig {
    pub fn new(config: &RenderConfig) -> Self {
        Self {
            near_clip: config.near_clip as f32,
            distortion_factor: config.distortion_factor() as f32,
            centre_depth_when_lowpass: config.centre_depth_when_lowpass,
        }
    }
}

/// What the pixels of one row have gathered so far.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    pub transmittance: Lanes,
    pub colour: [Lanes; 3],
    pub depth: Lanes,
    pub normal: [Lanes; 3],
    /// `sum w m` and `sum w m²` with `m` counted from the tile's reference.
    pub m1: Lanes,
    pub m2: Lanes,
    pub distortion: Lanes,
    pub median: Lanes,
    /// One past the position, in the tile's contributors, of the last splat blended; 0 for none.
    pub end: [u32; TILE],
    /// The same of the splat that set `median`.
    pub median_end: [u32; TILE],
    pub num_blended: [u32; TILE],
    /// 1 once the pixel is finished or outside the image.
    pub done: [u32; TILE],
}

impl Row {
    const EMPTY: Self = Self {
        transmittance: [1.0; TILE],
        colour: [[0.0; TILE]; 3],
        depth: [0.0; TILE],
        normal: [[0.0; TILE]; 3],
        m1: [0.0; TILE],
        m2: [0.0; TILE],
        distortion: [0.0; TILE],
        median: [0.0; TILE],
        end: [0; TILE],
        median_end: [0; TILE],
        num_blended: [0; TILE],
        done: [0; TILE],
    };

    #[inline(always)]
    fn is_done(&self) -> bool {
        self.done.iter().fold(1, |all, &done| all & done) == 1
    }
}

/// A finished tile: its pixels, and who made them.
#[derive(Clone, Debug)]
pub(crate) struct Tile {
    pub rows: Vec<Row>,
    /// Surfels blended into at least one pixel, front to back.
    pub contributors: Vec<u32>,
    /// Inverse depth from which the distortion's depths count.
    pub reference: f32,
}

/// The job of blending one tile, as [`pulp::Arch::dispatch`] takes it.
pub(crate) struct BlendTile<'a, R> {
    /// First pixel of the tile.
    pub corner: (usize, usize),
    /// Width and height of the image.
    pub size: (usize, usize),
    /// Surfels to look at, front to back.
    pub surfels: R,
    /// Splats of all surfels.
    pub splats: &'a [Splat],
    pub config: BlendConfig,
}

impl<R: Iterator<Item = u32>> WithSimd for BlendTile<'_, R> {
    type Output = Tile;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Tile {
        blend_tile(self.corner, self.size, self.surfels, self.splats, &self.config)
    }
}

#[inline(always)]
fn blend_tile(
    corner: (usize, usize),
    size: (usize, usize),
    surfels: impl Iterator<Item = u32>,
    splats: &[Splat],
    config: &BlendConfig,
) -> Tile {
    let num_rows = TILE.min(size.1 - corner.1);
    let mut empty = Row::EMPTY;
    for (lane, done) in empty.done.iter_mut().enumerate() {
        *done = u32::from(corner.0 + lane >= size.0);
    }
    let mut tile = Tile { rows: vec![empty; num_rows], contributors: Vec::new(), reference: 0.0 };
    let mut unfinished = num_rows;
    for surfel in surfels {
        let splat = &splats[surfel as usize];
        if tile.contributors.is_empty() {
            tile.reference = 1.0 / splat.z_centre;
        }
        let end = tile.contributors.len() as u32 + 1;
        let mut blended = false;
        for row in rows_of(splat, corner, num_rows) {
            let state = &mut tile.rows[row];
            if state.is_done() {
                continue;
            }
            let sight = evaluate_row(splat, corner.0, corner.1 + row, config);
            if sight.any {
                blended = true;
                blend_row(state, splat, &sight, end, tile.reference, config);
                unfinished -= usize::from(state.is_done());
            }
        }
        if blended {
            tile.contributors.push(surfel);
        }
        if unfinished == 0 {
            break;
        }
    }
    tile
}

/// Rows of the tile inside the splat's rectangle; none when its columns pass the tile by.
#[inline(always)]
pub(crate) fn rows_of(splat: &Splat, corner: (usize, usize), num_rows: usize) -> std::ops::Range<usize> {
    let rect = &splat.rect;
    if rect.x1 as usize <= corner.0 || rect.x0 as usize >= corner.0 + TILE {
        return 0..0;
    }
    (rect.y0 as usize).saturating_sub(corner.1).min(num_rows)..(rect.y1 as usize).saturating_sub(corner.1).min(num_rows)
}

/// A splat as the pixels of one row see it. Lanes that do not see it have alpha 0 and finite values.
pub(crate) struct Sight {
    /// Opacity times Gaussian, at most 0.99; 0 where it does not count.
    pub alpha: Lanes,
    pub gauss: Lanes,
    pub u: Lanes,
    pub v: Lanes,
    pub z: Lanes,
    pub inverse_z: Lanes,
    /// `1 / g_z`.
    pub inverse_g: Lanes,
    /// Offset from the low-pass centre to the pixel, columns; rows share `lowpass_dy`.
    pub lowpass_dx: Lanes,
    pub lowpass_dy: f32,
    /// 1 where the surfel, 0 where the low-pass defines the value.
    pub surfel_wins: [u32; TILE],
    pub any: bool,
}

#[inline(always)]
pub(crate) fn evaluate_row(splat: &Splat, first_column: usize, row: usize, config: &BlendConfig) -> Sight {
    let dy = (row as i32 - splat.origin[1]) as f32;
    let first_dx = (first_column as i32 - splat.origin[0]) as f32;
    let (ax, ay, az) = (splat.per_x[0], splat.per_x[1], splat.per_x[2]);
    let bx = splat.per_y[0] * dy + splat.at_origin[0];
    let by = splat.per_y[1] * dy + splat.at_origin[1];
    let bz = splat.per_y[2] * dy + splat.at_origin[2];
    let lowpass_dy = dy - splat.lowpass[1];
    let lowpass_dy_sq = lowpass_dy * lowpass_dy;
    let centre_inverse_z = 1.0 / splat.z_centre;
    let columns = (splat.rect.x0 as i32 - first_column as i32, splat.rect.x1 as i32 - first_column as i32);
    let mut sight = Sight {
        alpha: [0.0; TILE],
        gauss: [0.0; TILE],
        u: [0.0; TILE],
        v: [0.0; TILE],
        z: [0.0; TILE],
        inverse_z: [0.0; TILE],
        inverse_g: [0.0; TILE],
        lowpass_dx: [0.0; TILE],
        lowpass_dy,
        surfel_wins: [0; TILE],
        any: false,
    };
    let mut any = 0u32;
    for lane in 0..TILE {
        let dx = first_dx + lane as f32;
        let g_z = az * dx + bz;
        let inverse_g = 1.0 / g_z;
        let u = (ax * dx + bx) * inverse_g;
        let v = (ay * dx + by) * inverse_g;
        let rho_surfel = u * u + v * v;
        let lowpass_dx = dx - splat.lowpass[0];
        let rho_lowpass = 2.0 * (lowpass_dx * lowpass_dx + lowpass_dy_sq);
        let surfel_wins = rho_surfel <= rho_lowpass;
        let rho = if surfel_wins { rho_surfel } else { rho_lowpass };
        let gauss = exp_neg(-0.5 * rho);
        let unclamped = splat.opacity * gauss;
        let alpha = if unclamped < MAX_ALPHA as f32 { unclamped } else { MAX_ALPHA as f32 };
        let at_centre = config.centre_depth_when_lowpass & !surfel_wins;
        let z = if at_centre { splat.z_centre } else { splat.depth_scale * inverse_g };
        let inverse_z = if at_centre { centre_inverse_z } else { splat.inverse_depth_scale * g_z };
        let in_box = (lane as i32 >= columns.0) & ((lane as i32) < columns.1);
        let seen = in_box & (g_z != 0.0) & (z >= config.near_clip) & (z > 0.0) & (alpha >= MIN_ALPHA as f32);
        let keep = |value: f32| if seen { value } else { 0.0 };
        sight.alpha[lane] = keep(alpha);
        sight.gauss[lane] = keep(gauss);
        sight.u[lane] = keep(u);
        sight.v[lane] = keep(v);
        sight.z[lane] = keep(z);
        sight.inverse_z[lane] = keep(inverse_z);
        sight.inverse_g[lane] = keep(inverse_g);
        sight.lowpass_dx[lane] = lowpass_dx;
        sight.surfel_wins[lane] = u32::from(surfel_wins);
        any |= u32::from(seen);
    }
    sight.any = any != 0;
    sight
}

#[inline(always)]
fn blend_row(row: &mut Row, splat: &Splat, sight: &Sight, end: u32, reference: f32, config: &BlendConfig) {
    let mut blended = [0u32; TILE];
    let mut is_median = [0u32; TILE];
    // Decisions are integers and updates arithmetic that cannot trap: anything else the compiler turns into a
    // branch per lane.
    for lane in 0..TILE {
        let (alpha, before) = (sight.alpha[lane], row.transmittance[lane]);
        let offered = u32::from(alpha > 0.0) & (row.done[lane] ^ 1);
        let saturated = offered & u32::from(before * (1.0 - alpha) < MIN_TRANSMITTANCE as f32);
        blended[lane] = offered ^ saturated;
        is_median[lane] = blended[lane] & u32::from(before > 0.5);
        row.done[lane] |= saturated;
    }
    let mut weight = [0.0; TILE];
    let mut opaque = [0.0; TILE];
    for lane in 0..TILE {
        let before = row.transmittance[lane];
        let alpha = sight.alpha[lane] * blended[lane] as f32;
        weight[lane] = alpha * before;
        opaque[lane] = 1.0 - before;
        row.transmittance[lane] = before * (1.0 - alpha);
    }
    for lane in 0..TILE {
        let take = is_median[lane] as f32;
        row.median[lane] = take * sight.z[lane] + (1.0 - take) * row.median[lane];
    }
    for lane in 0..TILE {
        row.end[lane] = row.end[lane].max(blended[lane].wrapping_mul(end));
        row.median_end[lane] = row.median_end[lane].max(is_median[lane].wrapping_mul(end));
        row.num_blended[lane] = row.num_blended[lane].wrapping_add(blended[lane]);
    }
    for lane in 0..TILE {
        let w = weight[lane];
        let m = config.distortion_factor * (reference - sight.inverse_z[lane]);
        let wm = w * m;
        row.distortion[lane] += w * (m * m * opaque[lane] + row.m2[lane] - 2.0 * m * row.m1[lane]);
        row.m1[lane] += wm;
        row.m2[lane] += wm * m;
        row.depth[lane] += w * sight.z[lane];
    }
    for channel in 0..3 {
        for lane in 0..TILE {
            row.colour[channel][lane] += weight[lane] * splat.colour[channel];
            row.normal[channel][lane] += weight[lane] * splat.normal[channel];
        }
    }
}
