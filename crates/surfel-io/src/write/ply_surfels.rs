//! `surfels.ply`: surfels in the layout every 3D Gaussian splatting viewer opens (spec 6.3).
//!
//! Opacity is a logit, scales are logarithms, rotations are `world_from_surfel` in w x y z, SH is
//! channel-major. Invariant: [`super::surfels_from_ply`] reads back what was written, to f32 rounding.

use super::error::unfit;
use super::placed_mesh::{bounds, loses_in_single};
use super::ply_header::PlyHeader;
use glam::{DMat3, DQuat, DVec3, Vec3};
use std::io::{self, Write};
use surfel_core::sh::ShRotation;
use surfel_core::{Similarity, Surfels};

/// `scale_2` of a disc, before activation: the value the authors of 2DGS give for viewers of 3DGS.
pub const THICKNESS: f64 = 1e-6;

/// Which columns the file has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SplatLayout {
    /// With `scale_2 = ln 1e-6`: a flat ellipsoid to viewers of 3DGS.
    #[default]
    ThreeScales,
    /// Without: what 2DGS itself writes. Some viewers refuse it.
    TwoScales,
}

/// Writes surfels in the scene frame; `comments` go to the header (state the frame and the unit).
///
/// Viewers read floats only. Far from the origin, where floats would lose detail, positions are relative
/// to the centre of the set and the header says `comment origin X Y Z`, to be added.
///
/// # Errors
/// When the arrays disagree in length, the SH degree is above 3, or `out` refuses.
pub fn write_surfels_ply(
    out: &mut impl Write,
    surfels: &Surfels,
    scene_from_surfels: &Similarity,
    layout: SplatLayout,
    comments: &[&str],
) -> io::Result<()> {
    if !surfels.is_consistent() || surfels.sh_degree > surfel_core::sh::MAX_DEGREE {
        return Err(unfit(format!(
            "{} surfels of SH degree {} come with arrays of another length",
            surfels.len(),
            surfels.sh_degree
        )));
    }
    let centres = || surfels.centres.iter().map(|c| scene_from_surfels.transform(Vec3::from(*c).as_dvec3()));
    let far_away = bounds(centres()).filter(|&(low, high)| loses_in_single(low, high));
    let origin = far_away.map_or(DVec3::ZERO, |(low, high)| (low + high) / 2.0);
    header(surfels, layout, comments, origin).write(out)?;

    let turn = DQuat::from_mat3(&scene_from_surfels.rotation);
    let sh_turn = ShRotation::new(scene_from_surfels.rotation);
    let n = surfels.num_coefficients();
    let mut row = Vec::new();
    for (k, centre) in centres().enumerate() {
        row.clear();
        let [w, x, y, z] = surfels.rotations[k].map(f64::from);
        let rotation = (turn * DQuat::from_xyzw(x, y, z, w)).normalize();
        row.extend((centre - origin).to_array());
        row.extend(DMat3::from_quat(rotation).z_axis.to_array());
        row.extend(channel_major(&surfels.sh[k * n..][..n], &sh_turn));
        row.push(logit(surfels.opacities[k]));
        row.extend(surfels.scales[k].map(|s| (f64::from(s) * scene_from_surfels.scale).max(1e-12).ln()));
        if layout == SplatLayout::ThreeScales {
            row.push(THICKNESS.ln());
        }
        row.extend([rotation.w, rotation.x, rotation.y, rotation.z]);
        let bytes: Vec<u8> = row.iter().flat_map(|&value: &f64| (value as f32).to_le_bytes()).collect();
        out.write_all(&bytes)?;
    }
    Ok(())
}

fn header(surfels: &Surfels, layout: SplatLayout, comments: &[&str], origin: DVec3) -> PlyHeader {
    let origin = (origin != DVec3::ZERO).then(|| format!("origin {} {} {}", origin.x, origin.y, origin.z));
    let degree = format!("sh_degree {}", surfels.sh_degree);
    let comments: Vec<&str> = comments.iter().copied().chain([degree.as_str()]).chain(origin.as_deref()).collect();
    let num_scales = if layout == SplatLayout::ThreeScales { 3 } else { 2 };
    PlyHeader::new(&comments)
        .element("vertex", surfels.len())
        .properties("float", ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"])
        .properties("float", (0..3 * (surfels.num_coefficients() - 1)).map(|i| format!("f_rest_{i}")))
        .properties("float", ["opacity"])
        .properties("float", (0..num_scales).map(|i| format!("scale_{i}")))
        .properties("float", (0..4).map(|i| format!("rot_{i}")))
}

/// `f_dc` of the three channels, then `f_rest`: all of red, all of green, all of blue.
fn channel_major(sh: &[[f32; 3]], turn: &ShRotation) -> Vec<f64> {
    let turned: [Vec<f64>; 3] = std::array::from_fn(|channel| {
        let mut coefficients: Vec<f64> = sh.iter().map(|c| f64::from(c[channel])).collect();
        turn.apply(&mut coefficients);
        coefficients
    });
    let dc = turned.iter().map(|channel| channel[0]);
    dc.chain(turned.iter().flat_map(|channel| channel[1..].iter().copied())).collect()
}

/// The clamp keeps 0 and 1 finite; 1e-6 is far below what an 8-bit pixel shows.
fn logit(opacity: f32) -> f64 {
    let o = f64::from(opacity).clamp(1e-6, 1.0 - 1e-6);
    (o / (1.0 - o)).ln()
}
