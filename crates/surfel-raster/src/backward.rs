//! Gradients of the maps to gradients of the surfels (spec 3.6, 3.7).
//!
//! Tiles run in parallel and write one gradient per contributor; surfels then gather theirs tile by tile in a
//! fixed order. Invariant: the gradients are the same bits for any number of threads.

use crate::blend::{BlendConfig, Tile};
use crate::blend_backward::{BlendTileBackward, RowGrad, SplatGrad};
use crate::forward::Tape;
use crate::geometry_backward::{ScreenGrad, surfel_grad, transform_grad};
use crate::project::project;
use crate::splat::LinearForm;
use crate::tile::TILE;
use crate::{MapGrads, RasterError, SurfelGrads, SurfelSlices};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Gradients of `sum over maps (map_grads . map)` with respect to the surfels that were rendered.
///
/// A surfel that was skipped or not blended anywhere gets zeros, and so does one whose gradient does not fit
/// f32 (a plane seen all but edge-on).
///
/// # Errors
/// [`RasterError`] when a gradient map has another size than the rendering or holds a value that is not finite,
/// or when the surfels are not as many as the tape's.
pub fn backward(surfels: &SurfelSlices, tape: &Tape, map_grads: &MapGrads) -> Result<SurfelGrads, RasterError> {
    surfels.validate()?;
    if surfels.len() != tape.num_surfels {
        return Err(RasterError::OtherSurfels { recorded: tape.num_surfels, given: surfels.len() });
    }
    map_grads.validate(tape.camera.width, tape.camera.height)?;
    let arch = pulp::Arch::new();
    let config = BlendConfig::new(&tape.config);
    let per_tile: Vec<Vec<SplatGrad>> = tape
        .tiles
        .par_iter()
        .enumerate()
        .map(|(index, tile)| {
            let corner = tape.grid.corner(index);
            arch.dispatch(BlendTileBackward {
                corner,
                tile,
                splats: &tape.sorted.splats,
                grads: &row_grads(map_grads, tile, corner, tape.camera.width),
                background: tape.config.background,
                config,
                reference_grad: tape.config.reference_grad,
            })
        })
        .collect();
    let per_rank = gather(&tape.tiles, &per_tile, tape.sorted.splats.len());
    Ok(surfel_grads(surfels, tape, &per_rank))
}

/// The tile's part of the incoming gradients, with that of the expected depth spread over sum and alpha.
fn row_grads(grads: &MapGrads, tile: &Tile, corner: (usize, usize), width: usize) -> Vec<RowGrad> {
    let num_columns = TILE.min(width - corner.0);
    tile.rows
        .iter()
        .enumerate()
        .map(|(row, pixels)| {
            let mut out = RowGrad::ZERO;
            for lane in 0..num_columns {
                let at = (corner.0 + lane, corner.1 + row);
                if let Some(colour) = &grads.colour {
                    (0..3).for_each(|c| out.colour[c][lane] = colour[at][c]);
                }
                if let Some(normal) = &grads.normal {
                    (0..3).for_each(|c| out.normal[c][lane] = normal[at][c]);
                }
                let value = |map: &Option<surfel_core::Grid<f32>>| map.as_ref().map_or(0.0, |grid| grid[at]);
                out.alpha[lane] = value(&grads.alpha);
                out.depth[lane] = value(&grads.depth_sum);
                out.median[lane] = value(&grads.depth_median);
                out.distortion[lane] = value(&grads.distortion);
                let alpha = 1.0 - pixels.transmittance[lane];
                if alpha > 0.0 {
                    let expected = value(&grads.depth_expected) / alpha;
                    out.depth[lane] += expected;
                    out.alpha[lane] -= expected * pixels.depth[lane] / alpha;
                }
            }
            out
        })
        .collect()
}

/// Gradients of one splat summed over tiles.
#[derive(Clone, Copy, Default)]
struct RankGrad {
    per_x: DVec3,
    per_y: DVec3,
    at_origin: DVec3,
    z_terms: DVec3,
    lowpass: DVec2,
    opacity: f64,
    colour: DVec3,
    normal: DVec3,
}

impl RankGrad {
    fn add(&mut self, g: &SplatGrad) {
        let wide = |v: [f32; 3]| DVec3::from(v.map(f64::from));
        self.per_x += wide(g.per_x);
        self.per_y += wide(g.per_y);
        self.at_origin += wide(g.at_origin);
        self.z_terms += wide(g.z_terms);
        self.lowpass += DVec2::from(g.lowpass.map(f64::from));
        self.opacity += f64::from(g.opacity);
        self.colour += wide(g.colour);
        self.normal += wide(g.normal);
    }
}

/// Sums the tiles' gradients per rank. Contributors ascend in rank, so a range of ranks is a range of every
/// tile's list and ranges can go to different threads.
fn gather(tiles: &[Tile], per_tile: &[Vec<SplatGrad>], num_ranks: usize) -> Vec<RankGrad> {
    const MAX_RANGES: usize = 64;
    let mut sums = vec![RankGrad::default(); num_ranks];
    let range = num_ranks.div_ceil(MAX_RANGES).max(1);
    sums.par_chunks_mut(range).enumerate().for_each(|(i, sums)| {
        let first = (i * range) as u32;
        let last = first + sums.len() as u32;
        for (tile, grads) in tiles.iter().zip(per_tile) {
            let start = tile.contributors.partition_point(|&rank| rank < first);
            for (&rank, grad) in tile.contributors[start..].iter().zip(&grads[start..]) {
                if rank >= last {
                    break;
                }
                sums[(rank - first) as usize].add(grad);
            }
        }
    });
    sums
}

fn surfel_grads(surfels: &SurfelSlices, tape: &Tape, per_rank: &[RankGrad]) -> SurfelGrads {
    let n = surfels.len();
    let mut rank_of_surfel = vec![u32::MAX; n];
    for (rank, &surfel) in tape.sorted.surfel_of_rank.iter().enumerate() {
        rank_of_surfel[surfel as usize] = rank as u32;
    }
    let mut out = SurfelGrads {
        centres: vec![[0.0; 3]; n],
        scales: vec![[0.0; 2]; n],
        rotations: vec![[0.0; 4]; n],
        opacities: vec![0.0; n],
        sh: vec![[0.0; 3]; surfels.sh.len()],
    };
    let shapes = out.centres.par_iter_mut().zip(&mut out.scales).zip(&mut out.rotations).zip(&mut out.opacities);
    shapes.zip(out.sh.par_chunks_mut(surfels.num_coefficients())).enumerate().for_each(
        |(index, ((((centre, scales), rotation), opacity), sh))| {
            let Some(grad) = per_rank.get(rank_of_surfel[index] as usize) else { return };
            let mut d_sh = [[0.0; 3]; 16];
            let d_sh = &mut d_sh[..sh.len()];
            let Some(shape) = one_surfel(surfels, tape, index, grad, d_sh) else { return };
            *centre = shape.centre.as_vec3().to_array();
            *scales = shape.scales.as_vec2().to_array();
            *rotation = shape.rotation.map(|c| c as f32);
            *opacity = shape.opacity as f32;
            for (narrow, wide) in sh.iter_mut().zip(d_sh) {
                *narrow = wide.map(|c| c as f32);
            }
            let fits = |values: &[f32]| values.iter().all(|value| value.is_finite());
            if !(fits(centre) && fits(scales) && fits(rotation) && opacity.is_finite() && fits(sh.as_flattened())) {
                (*centre, *scales, *rotation, *opacity) = ([0.0; 3], [0.0; 2], [0.0; 4], 0.0);
                sh.fill([0.0; 3]);
            }
        },
    );
    out
}

fn one_surfel(
    surfels: &SurfelSlices,
    tape: &Tape,
    index: usize,
    grad: &RankGrad,
    d_sh: &mut [[f64; 3]],
) -> Option<crate::geometry_backward::ShapeGrad> {
    let shape = surfels.shape(index);
    let projected = project(&tape.camera, &tape.config, &shape)?;
    let form = LinearForm::new(&tape.camera, &projected);
    let transform = &projected.footprint.transform;
    let d = transform_grad(&form, transform, grad.per_x, grad.per_y, grad.at_origin);
    let screen = ScreenGrad {
        tu: d.tu,
        tv: d.tv,
        tw: d.tw + grad.z_terms,
        lowpass: grad.lowpass,
        normal: grad.normal,
        colour: grad.colour.to_array(),
        opacity: grad.opacity,
    };
    let mut coefficients = [[0.0; 3]; 16];
    for (wide, narrow) in coefficients.iter_mut().zip(surfels.sh_of(index)) {
        *wide = narrow.map(f64::from);
    }
    Some(surfel_grad(&tape.camera, &tape.config, &shape, &coefficients[..d_sh.len()], &projected, &screen, d_sh))
}
