//! Back-to-front gradients of one tile, a row of pixels at a time (spec 3.6, 3.7).
//!
//! Walks the tile's contributors in reverse and undoes their transmittance. What every pixel of a splat adds to
//! the gradient is linear in the pixel's offset, so the sums over a tile stay small: per component of the
//! homogeneous hit a plain sum, one weighted by column and one by row. Invariant: sums run in a fixed order.

use crate::blend::{BlendConfig, Lanes, Sight, Tile, evaluate_row, rows_of};
use crate::config::MAX_ALPHA;
use crate::splat::Splat;
use crate::tile::TILE;
use pulp::{Simd, WithSimd};

/// Incoming gradients of one row of pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RowGrad {
    pub colour: [Lanes; 3],
    pub alpha: Lanes,
    pub depth: Lanes,
    pub median: Lanes,
    pub normal: [Lanes; 3],
    pub distortion: Lanes,
}

impl RowGrad {
    pub const ZERO: Self = Self {
        colour: [[0.0; TILE]; 3],
        alpha: [0.0; TILE],
        depth: [0.0; TILE],
        median: [0.0; TILE],
        normal: [[0.0; TILE]; 3],
        distortion: [0.0; TILE],
    };
}

/// Gradient of the fields of a [`Splat`] of the same names; `z_terms` per `(z_slope, z_centre)`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SplatGrad {
    pub per_x: [f32; 3],
    pub per_y: [f32; 3],
    pub at_origin: [f32; 3],
    pub z_terms: [f32; 3],
    pub lowpass: [f32; 2],
    pub opacity: f32,
    pub colour: [f32; 3],
    pub normal: [f32; 3],
}

/// The job of one tile, as [`pulp::Arch::dispatch`] takes it; returns one gradient per contributor.
pub(crate) struct BlendTileBackward<'a> {
    pub corner: (usize, usize),
    pub tile: &'a Tile,
    pub splats: &'a [Splat],
    /// One per row of the tile.
    pub grads: &'a [RowGrad],
    pub background: [f32; 3],
    pub config: BlendConfig,
    /// See [`crate::RenderConfig::reference_grad`].
    pub reference_grad: bool,
}

impl WithSimd for BlendTileBackward<'_> {
    type Output = Vec<SplatGrad>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Vec<SplatGrad> {
        self.run()
    }
}

/// What is left of a row's pixels while surfels are taken off from the back.
#[derive(Clone, Copy)]
struct Behind {
    transmittance: Lanes,
    /// Value of what lies behind, per unit of light that reaches it.
    value: Lanes,
}

/// Sums over the rows of a tile; lanes are columns.
struct Sums {
    g: [Lanes; 3],
    g_by_row: [Lanes; 3],
    z_terms: [Lanes; 3],
    lowpass: [Lanes; 2],
    opacity: Lanes,
    colour: [Lanes; 3],
    normal: [Lanes; 3],
}

impl BlendTileBackward<'_> {
    #[inline(always)]
    fn run(self) -> Vec<SplatGrad> {
        let tile = self.tile;
        let num_rows = tile.rows.len();
        let mut behind: Vec<Behind> = (0..num_rows).map(|row| self.start(row)).collect();
        let mut out = vec![SplatGrad::default(); tile.contributors.len()];
        for position in (0..tile.contributors.len()).rev() {
            let splat = &self.splats[tile.contributors[position] as usize];
            let mut sums = Sums::ZERO;
            for row in rows_of(splat, self.corner, num_rows) {
                let sight = evaluate_row(splat, self.corner.0, self.corner.1 + row, &self.config);
                if sight.any {
                    let dy = ((self.corner.1 + row) as i32 - splat.origin[1]) as f32;
                    self.row_backward(splat, &sight, row, dy, position as u32 + 1, &mut behind[row], &mut sums);
                }
            }
            out[position] = sums.finish((self.corner.0 as i32 - splat.origin[0]) as f32);
        }
        out
    }

    /// Behind everything lies the background.
    #[inline(always)]
    fn start(&self, row: usize) -> Behind {
        let colour = &self.grads[row].colour;
        let [r, g, b] = self.background;
        Behind {
            transmittance: self.tile.rows[row].transmittance,
            value: std::array::from_fn(|lane| colour[0][lane] * r + colour[1][lane] * g + colour[2][lane] * b),
        }
    }

    #[inline(always)]
    fn row_backward(
        &self,
        splat: &Splat,
        sight: &Sight,
        row: usize,
        dy: f32,
        end: u32,
        behind: &mut Behind,
        sums: &mut Sums,
    ) {
        let (done, g) = (&self.tile.rows[row], &self.grads[row]);
        let (factor, reference) = (self.config.distortion_factor, self.tile.reference);
        let exact = u32::from(!self.reference_grad);
        let mut blended = [0.0; TILE];
        let mut weight = [0.0; TILE];
        let mut d_gauss_gauss = [0.0; TILE];
        let mut d_z = [0.0; TILE];
        for lane in 0..TILE {
            blended[lane] = (u32::from(sight.alpha[lane] > 0.0) & u32::from(end <= done.end[lane])) as f32;
        }
        for lane in 0..TILE {
            let alpha = sight.alpha[lane] * blended[lane];
            let before = behind.transmittance[lane] / (1.0 - alpha);
            let w = alpha * before;
            let m = factor * (reference - sight.inverse_z[lane]);
            let opaque = 1.0 - done.transmittance[lane];
            let value = g.colour[0][lane] * splat.colour[0]
                + g.colour[1][lane] * splat.colour[1]
                + g.colour[2][lane] * splat.colour[2]
                + g.normal[0][lane] * splat.normal[0]
                + g.normal[1][lane] * splat.normal[1]
                + g.normal[2][lane] * splat.normal[2]
                + g.depth[lane] * sight.z[lane]
                + g.alpha[lane]
                + g.distortion[lane] * (m * m * opaque + done.m2[lane] - 2.0 * m * done.m1[lane]);
            let d_alpha = before * (value - behind.value[lane]) * blended[lane];
            behind.value[lane] += alpha * (value - behind.value[lane]);
            behind.transmittance[lane] = before;
            let is_median = u32::from(done.median_end[lane] == end) as f32;
            let slope = factor * sight.inverse_z[lane] * sight.inverse_z[lane];
            d_z[lane] = w * g.depth[lane]
                + is_median * g.median[lane]
                + g.distortion[lane] * 2.0 * w * (m * opaque - done.m1[lane]) * slope;
            let unclamped = splat.opacity * sight.gauss[lane];
            let clamped = u32::from(unclamped >= MAX_ALPHA as f32) & exact;
            let d_alpha = d_alpha * (clamped ^ 1) as f32;
            weight[lane] = w;
            d_gauss_gauss[lane] = unclamped * d_alpha;
            sums.opacity[lane] += sight.gauss[lane] * d_alpha;
        }
        for channel in 0..3 {
            for lane in 0..TILE {
                sums.colour[channel][lane] += weight[lane] * g.colour[channel][lane];
                sums.normal[channel][lane] += weight[lane] * g.normal[channel][lane];
            }
        }
        self.hits_backward(splat, sight, &d_gauss_gauss, &d_z, dy, sums);
    }

    /// From the Gaussian and the depth to the homogeneous hit and the low-pass centre.
    #[inline(always)]
    fn hits_backward(
        &self,
        splat: &Splat,
        sight: &Sight,
        d_gauss_gauss: &Lanes,
        d_z: &Lanes,
        dy: f32,
        sums: &mut Sums,
    ) {
        let centre_depth = u32::from(self.config.centre_depth_when_lowpass);
        let drop_depth = u32::from(self.reference_grad) | centre_depth;
        for lane in 0..TILE {
            let (u, v, inverse_g) = (sight.u[lane], sight.v[lane], sight.inverse_g[lane]);
            let lowpass_wins = sight.surfel_wins[lane] ^ 1;
            let through_surfel = d_gauss_gauss[lane] * sight.surfel_wins[lane] as f32;
            let through_lowpass = d_gauss_gauss[lane] * lowpass_wins as f32;
            let d_z_uv = d_z[lane] * ((lowpass_wins & drop_depth) ^ 1) as f32;
            let d_z_slope = d_z[lane] * ((lowpass_wins & centre_depth) ^ 1) as f32;
            let d_u = d_z_uv * splat.z_slope[0] - through_surfel * u;
            let d_v = d_z_uv * splat.z_slope[1] - through_surfel * v;
            let d_g = [d_u * inverse_g, d_v * inverse_g, -(d_u * u + d_v * v) * inverse_g];
            for axis in 0..3 {
                sums.g[axis][lane] += d_g[axis];
                sums.g_by_row[axis][lane] += d_g[axis] * dy;
            }
            sums.z_terms[0][lane] += d_z_slope * u;
            sums.z_terms[1][lane] += d_z_slope * v;
            sums.z_terms[2][lane] += d_z[lane];
            sums.lowpass[0][lane] += 2.0 * through_lowpass * sight.lowpass_dx[lane];
            sums.lowpass[1][lane] += 2.0 * through_lowpass * sight.lowpass_dy;
        }
    }
}

impl Sums {
    const ZERO: Self = Self {
        g: [[0.0; TILE]; 3],
        g_by_row: [[0.0; TILE]; 3],
        z_terms: [[0.0; TILE]; 3],
        lowpass: [[0.0; TILE]; 2],
        opacity: [0.0; TILE],
        colour: [[0.0; TILE]; 3],
        normal: [[0.0; TILE]; 3],
    };

    /// Adds the columns up; `first_dx` is the offset of the first from the splat's origin.
    #[inline(always)]
    fn finish(&self, first_dx: f32) -> SplatGrad {
        let by_column: [Lanes; 3] =
            std::array::from_fn(|axis| std::array::from_fn(|lane| self.g[axis][lane] * (first_dx + lane as f32)));
        SplatGrad {
            per_x: std::array::from_fn(|axis| sum(&by_column[axis])),
            per_y: std::array::from_fn(|axis| sum(&self.g_by_row[axis])),
            at_origin: std::array::from_fn(|axis| sum(&self.g[axis])),
            z_terms: std::array::from_fn(|axis| sum(&self.z_terms[axis])),
            lowpass: std::array::from_fn(|axis| sum(&self.lowpass[axis])),
            opacity: sum(&self.opacity),
            colour: std::array::from_fn(|channel| sum(&self.colour[channel])),
            normal: std::array::from_fn(|axis| sum(&self.normal[axis])),
        }
    }
}

/// Halves until one is left: short chains, and the same order on every machine.
#[inline(always)]
fn sum(lanes: &Lanes) -> f32 {
    let mut left = *lanes;
    let mut width = TILE / 2;
    while width > 0 {
        for lane in 0..width {
            left[lane] += left[lane + width];
        }
        width /= 2;
    }
    left[0]
}
