//! Gradients of the maps to gradients of the surfels (spec 3.6, 3.7).
//!
//! Tiles run in parallel and write one gradient per contributor; surfels then sum theirs in order of tiles. Invariant: the gradients are the same bits for any number of threads.

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
    if surfels.len() != tape.splats.len() {
        return Err(RasterError::OtherSurfels { recorded: tape.splats.len(), given: surfels.len() });
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
                splats: &tape.splats,
                grads: &row_grads(map_grads, tile, corner, tape.camera.width),
                background: tape.config.background,
                config,
                reference_grad: tape.config.reference_grad,
            })
        })
        .collect();
    let shares = Shares::new(&tape.tiles, &per_tile, tape.splats.len());
    Ok(surfel_grads(surfels, tape, &shares))
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
struct SummedGrad {
    per_x: DVec3,
    per_y: DVec3,
    at_origin: DVec3,
    z_terms: DVec3,
    lowpass: DVec2,
    opacity: f64,
    colour: DVec3,
    normal: DVec3,
}

impl SummedGrad {
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

/// The tiles' gradients regrouped by surfel: those of surfel `k` are `grads[starts[k]..starts[k + 1]]`, in order
/// of tiles.
struct Shares {
    starts: Vec<u32>,
    grads: Vec<SplatGrad>,
}

impl Shares {
    fn new(tiles: &[Tile], per_tile: &[Vec<SplatGrad>], num_surfels: usize) -> Self {
        let mut starts = vec![0u32; num_surfels + 1];
        for &surfel in tiles.iter().flat_map(|tile| &tile.contributors) {
            starts[surfel as usize + 1] += 1;
        }
        for surfel in 0..num_surfels {
            starts[surfel + 1] += starts[surfel];
        }
        let mut next = starts.clone();
        let mut grads = vec![SplatGrad::default(); starts[num_surfels] as usize];
        for (tile, of_tile) in tiles.iter().zip(per_tile) {
            for (&surfel, grad) in tile.contributors.iter().zip(of_tile) {
                grads[next[surfel as usize] as usize] = *grad;
                next[surfel as usize] += 1;
            }
        }
        Self { starts, grads }
    }

    /// `None` for a surfel blended nowhere.
    fn sum(&self, surfel: usize) -> Option<SummedGrad> {
        let grads = &self.grads[self.starts[surfel] as usize..self.starts[surfel + 1] as usize];
        let mut sum = SummedGrad::default();
        grads.iter().for_each(|grad| sum.add(grad));
        (!grads.is_empty()).then_some(sum)
    }
}

fn surfel_grads(surfels: &SurfelSlices, tape: &Tape, shares: &Shares) -> SurfelGrads {
    let n = surfels.len();
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
            let Some(grad) = shares.sum(index) else { return };
            let mut d_sh = [[0.0; 3]; 16];
            let d_sh = &mut d_sh[..sh.len()];
            let Some(shape) = one_surfel(surfels, tape, index, &grad, d_sh) else { return };
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
    grad: &SummedGrad,
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
