//! From gradients on the screen to gradients of a surfel's parameters, in f64 (spec 3.7).
//!
//! Shared by the fast backward pass and the twin's, so finite differences of the twin check it for both.

use crate::RenderConfig;
use crate::pixel_camera::PixelCamera;
use crate::project::Projected;
use crate::quaternion;
use crate::ray_splat::SplatTransform;
use crate::sh_colour;
use crate::slices::SurfelShape;
use crate::splat::LinearForm;
use glam::{DMat3, DVec2, DVec3};

/// Gradients of what the pixels read of one surfel.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ScreenGrad {
    /// Per row of the splat transform.
    pub tu: DVec3,
    pub tv: DVec3,
    pub tw: DVec3,
    /// Per low-pass centre.
    pub lowpass: DVec2,
    /// Per camera-frame normal, as blended.
    pub normal: DVec3,
    pub colour: [f64; 3],
    pub opacity: f64,
}

/// Gradients of one surfel's parameters, but for SH.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ShapeGrad {
    pub centre: DVec3,
    pub scales: DVec2,
    pub rotation: [f64; 4],
    pub opacity: f64,
}

/// Gradients of the splat transform from those of its linear form (see [`crate::splat`]): the products
/// `tv x tw`, `tw x tu`, `tu x tv`, back through the shift of origin.
pub(crate) fn transform_grad(
    form: &LinearForm,
    transform: &SplatTransform,
    d_per_x: DVec3,
    d_per_y: DVec3,
    d_at_origin: DVec3,
) -> SplatTransform {
    let t = transform.relative_to(form.origin);
    let tu = d_per_y.cross(t.tw) + t.tv.cross(d_at_origin);
    let tv = t.tw.cross(d_per_x) + d_at_origin.cross(t.tu);
    let tw = d_per_x.cross(t.tv) + t.tu.cross(d_per_y);
    let (tu, tv, tw) = (tu * form.scale, tv * form.scale, tw * form.scale);
    SplatTransform { tu, tv, tw: tw - tu * form.origin.x - tv * form.origin.y }
}

/// Gradients of the surfel; those of its SH coefficients go to `d_sh`.
pub(crate) fn surfel_grad(
    camera: &PixelCamera,
    config: &RenderConfig,
    shape: &SurfelShape,
    sh: &[[f64; 3]],
    projected: &Projected,
    screen: &ScreenGrad,
    d_sh: &mut [[f64; 3]],
) -> ShapeGrad {
    let d_transform = with_lowpass_centre(config, projected, screen);
    let (focal, principal) = (camera.focal, camera.principal);
    let d_x = d_transform.tu * focal.x;
    let d_y = d_transform.tv * focal.y;
    let d_z = d_transform.tu * principal.x + d_transform.tv * principal.y + d_transform.tw;
    let world_from_camera = camera.camera_from_world.rotation.transpose();
    let column = |j: usize| world_from_camera * DVec3::new(d_x[j], d_y[j], d_z[j]);
    let (along_u, along_v, d_centre) = (column(0), column(1), column(2));

    let frame = &projected.world_from_surfel;
    let d_frame = DMat3::from_cols(
        along_u * shape.scales.x,
        along_v * shape.scales.y,
        world_from_camera * screen.normal * projected.facing,
    );
    let d_unit = quaternion::unit_grad(projected.unit_rotation, &d_frame);
    let rotation = if config.reference_grad {
        d_unit
    } else {
        quaternion::raw_grad(projected.unit_rotation, projected.rotation_length, d_unit)
    };

    let direction = projected.direction;
    let d_direction = sh_colour::colour_grad(sh, direction, screen.colour, d_sh);
    let turned = (d_direction - direction * direction.dot(d_direction)) / projected.distance;
    ShapeGrad {
        centre: d_centre + turned,
        scales: DVec2::new(frame.x_axis.dot(along_u), frame.y_axis.dot(along_v)),
        rotation,
        opacity: screen.opacity,
    }
}

/// Adds what moves the low-pass centre, which is a function of the transform (spec 3.3).
fn with_lowpass_centre(config: &RenderConfig, projected: &Projected, screen: &ScreenGrad) -> SplatTransform {
    let SplatTransform { tu, tv, tw } = projected.footprint.transform;
    let centre = projected.footprint.lowpass_centre;
    let cutoff_sq = config.cutoff * config.cutoff;
    let signature = DVec3::new(cutoff_sq, cutoff_sq, -1.0);
    let distance = signature.dot(tw * tw);
    let d = screen.lowpass;
    let through = |row: DVec3, c: f64| signature * row - signature * tw * (2.0 * c);
    SplatTransform {
        tu: screen.tu + signature * tw * (d.x / distance),
        tv: screen.tv + signature * tw * (d.y / distance),
        tw: screen.tw + (through(tu, centre.x) * d.x + through(tv, centre.y) * d.y) / distance,
    }
}
