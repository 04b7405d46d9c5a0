//! One vertex of the mesh: position, normal and colour on a crossed grid edge.
//!
//! Colours are looked up in the photographs at the vertex itself rather than averaged into voxels first:
//! sharper, and a field value is all a voxel has to hold. Invariant: vertices keep clear of the voxels at the
//! ends of their edge, so no triangle is degenerate.

use crate::{Tsdf, neighbourhood::Neighbourhood};
use glam::{DVec3, IVec3};

/// Closest a vertex comes to the end of its edge, in edge lengths; costs at most 0.4% of a voxel.
const END_GAP: f32 = 1.0 / 256.0;

/// Colour where no view with a finite colour looks: middle grey.
const NO_COLOUR: [u8; 3] = [128; 3];

/// A mesh vertex, scene frame and units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Vertex {
    pub position: [f32; 3],
    /// Unit, outward; zero where the gradient of the field vanishes.
    pub normal: [f32; 3],
    pub colour: [u8; 3],
}

/// The vertex on the edge from local voxel `start` along `axis`, in the block whose first voxel is `first`.
pub(crate) fn vertex_on_edge(
    tsdf: &Tsdf<'_>,
    around: &Neighbourhood,
    first: IVec3,
    start: IVec3,
    axis: usize,
) -> Vertex {
    let end = start + IVec3::AXES[axis];
    let along = crossing(around.at(start), around.at(end));
    let (low, high) = ((first + start).as_dvec3(), (first + end).as_dvec3());
    let grid = low.lerp(high, f64::from(along));
    let offset = tsdf.lattice.offset_from_grid(grid);
    let gradient = gradient(around, start).lerp(gradient(around, end), f64::from(along));
    let normal = tsdf.lattice.world_gradient(grid, gradient).unwrap_or(DVec3::ZERO);
    let colour = colour_at(tsdf, offset).or_else(|| {
        let ends = [low, high].map(|end| colour_at(tsdf, tsdf.lattice.offset_from_grid(end)));
        ends[0].or(ends[1])
    });
    Vertex {
        position: tsdf.lattice.world_from_offset(offset).as_vec3().to_array(),
        normal: normal.as_vec3().to_array(),
        colour: colour.unwrap_or(NO_COLOUR),
    }
}

/// Where along an edge the field crosses zero, in (0, 1).
pub(crate) fn crossing(start: f32, end: f32) -> f32 {
    (start / (start - end)).clamp(END_GAP, 1.0 - END_GAP)
}

/// Gradient of the field at an observed voxel: central differences, one-sided beside unobserved voxels.
fn gradient(around: &Neighbourhood, voxel: IVec3) -> DVec3 {
    let centre = around.at(voxel);
    let slope = |step: IVec3| {
        let (low, high) = (around.at(voxel - step), around.at(voxel + step));
        let slope = match (low.is_nan(), high.is_nan()) {
            (false, false) => (high - low) / 2.0,
            (true, false) => high - centre,
            (false, true) => centre - low,
            (true, true) => 0.0,
        };
        f64::from(slope)
    };
    DVec3::from_array(IVec3::AXES.map(slope))
}

/// Weighted mean colour of the views that see the surface within the truncation of an offset.
fn colour_at(tsdf: &Tsdf<'_>, offset: DVec3) -> Option<[u8; 3]> {
    let reach = tsdf.truncation * tsdf.lattice.spacing(offset) as f32;
    let (mut sum, mut total) = ([0.0; 3], 0.0);
    for observer in &tsdf.observers {
        let Some(([u, v], z)) = observer.project(offset) else {
            continue;
        };
        let Some(sample) = observer.sample(u, v).filter(|sample| (sample.depth - z).abs() <= reach) else {
            continue;
        };
        let Some(colour) = observer.colour(u, v) else {
            continue;
        };
        total += sample.weight;
        for (sum, channel) in sum.iter_mut().zip(colour) {
            *sum += sample.weight * channel;
        }
    }
    // `as` saturates, so values outside [0, 1] clip.
    (total > 0.0).then(|| sum.map(|sum| (sum / total * 255.0).round() as u8))
}
