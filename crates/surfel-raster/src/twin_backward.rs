//! The twin's gradients: spec 3.6 and 3.7 pixel by pixel and surfel by surfel, in f64.

use crate::config::MAX_ALPHA;
use crate::geometry_backward::{ScreenGrad, surfel_grad};
use crate::ray_splat::SplatTransform;
use crate::twin::{Blended, TwinScene, TwinSplat, TwinSurfels, mapped_depth};
use crate::{MapGrads, RasterError, RenderConfig};
use glam::{DVec2, DVec3};
use surfel_core::{Camera, Grid};

/// Gradients of `sum over maps (map_grads . map)` in the layout of the surfels; zero for skipped ones.
///
/// # Errors
/// As [`crate::twin::render`], and for a gradient of the wrong size.
pub fn backward(
    surfels: &TwinSurfels,
    camera: &Camera,
    config: &RenderConfig,
    map_grads: &MapGrads,
) -> Result<TwinSurfels, RasterError> {
    let scene = TwinScene::new(surfels, camera, config)?;
    map_grads.validate(camera.width, camera.height)?;
    let mut screen = vec![ScreenGrad::default(); scene.splats.len()];
    for y in 0..camera.height {
        for x in 0..camera.width {
            let (blended, transmittance, _) = scene.blend(config, x, y);
            let incoming = PixelGrad::of(map_grads, x, y, &blended, transmittance);
            pixel_backward(&scene, config, (x, y), &blended, transmittance, &incoming, &mut screen);
        }
    }
    let mut grads = surfels.clone();
    for shape in &mut grads.shapes {
        *shape =
            crate::slices::SurfelShape { centre: DVec3::ZERO, scales: DVec2::ZERO, rotation: [0.0; 4], opacity: 0.0 };
    }
    grads.sh.iter_mut().flatten().for_each(|c| *c = [0.0; 3]);
    for (splat, screen) in scene.splats.iter().zip(&screen) {
        let (shape, sh) = (&surfels.shapes[splat.index], &surfels.sh[splat.index]);
        let out = surfel_grad(&scene.camera, config, shape, sh, &splat.projected, screen, &mut grads.sh[splat.index]);
        let into = &mut grads.shapes[splat.index];
        (into.centre, into.scales, into.rotation, into.opacity) = (out.centre, out.scales, out.rotation, out.opacity);
    }
    Ok(grads)
}

/// Gradients of one pixel of the maps.
struct PixelGrad {
    colour: DVec3,
    alpha: f64,
    depth: f64,
    median: f64,
    normal: DVec3,
    distortion: f64,
}

impl PixelGrad {
    fn of(grads: &MapGrads, x: usize, y: usize, blended: &[Blended], transmittance: f64) -> Self {
        let at = |map: &Option<Grid<f32>>| map.as_ref().map_or(0.0, |grid| f64::from(grid[(x, y)]));
        let at3 = |map: &Option<Grid<[f32; 3]>>| {
            map.as_ref().map_or(DVec3::ZERO, |grid| DVec3::from(grid[(x, y)].map(f64::from)))
        };
        let mut out = Self {
            colour: at3(&grads.colour),
            alpha: at(&grads.alpha),
            depth: at(&grads.depth_sum),
            median: at(&grads.depth_median),
            normal: at3(&grads.normal),
            distortion: at(&grads.distortion),
        };
        let alpha = 1.0 - transmittance;
        if alpha > 0.0 {
            let depth: f64 = blended.iter().map(|b| b.alpha * b.transmittance * b.z).sum();
            let expected = at(&grads.depth_expected);
            out.depth += expected / alpha;
            out.alpha -= expected * depth / (alpha * alpha);
        }
        out
    }
}

fn pixel_backward(
    scene: &TwinScene,
    config: &RenderConfig,
    (x, y): (usize, usize),
    blended: &[Blended],
    transmittance: f64,
    g: &PixelGrad,
    screen: &mut [ScreenGrad],
) {
    let mapped: Vec<f64> = blended.iter().map(|b| mapped_depth(config, b.z)).collect();
    let weights: Vec<f64> = blended.iter().map(|b| b.alpha * b.transmittance).collect();
    let opaque: f64 = weights.iter().sum();
    let m1: f64 = weights.iter().zip(&mapped).map(|(w, m)| w * m).sum();
    let m2: f64 = weights.iter().zip(&mapped).map(|(w, m)| w * m * m).sum();
    let median = blended.iter().rposition(|b| b.transmittance > 0.5);
    let background = g.colour.dot(DVec3::from(config.background.map(f64::from)));
    let mut behind = 0.0;
    for (i, b) in blended.iter().enumerate().rev() {
        let splat = &scene.splats[b.splat];
        let (w, m) = (weights[i], mapped[i]);
        let value = g.colour.dot(splat.colour.into())
            + g.depth * b.z
            + g.normal.dot(splat.projected.normal)
            + g.alpha
            + g.distortion * (m * m * opaque + m2 - 2.0 * m * m1);
        let d_alpha = b.transmittance * (value - behind) - transmittance / (1.0 - b.alpha) * background;
        behind = b.alpha * value + (1.0 - b.alpha) * behind;
        let slope = config.distortion_factor() / (b.z * b.z);
        let mut d_z = w * g.depth + g.distortion * 2.0 * w * (m * opaque - m1) * slope;
        if median == Some(i) {
            d_z += g.median;
        }
        let into = &mut screen[b.splat];
        for channel in 0..3 {
            into.colour[channel] += w * g.colour[channel];
        }
        into.normal += g.normal * w;
        let clamped = splat.opacity * b.gauss > MAX_ALPHA && !config.reference_grad;
        let d_alpha = if clamped { 0.0 } else { d_alpha };
        into.opacity += b.gauss * d_alpha;
        hit_backward(config, splat, (x, y), b, splat.opacity * d_alpha, d_z, into);
    }
}

/// Spec 3.7, without the part of the low-pass centre.
fn hit_backward(
    config: &RenderConfig,
    splat: &TwinSplat,
    (x, y): (usize, usize),
    b: &Blended,
    d_gauss: f64,
    d_z: f64,
    into: &mut ScreenGrad,
) {
    let pixel = DVec2::new(x as f64, y as f64);
    let SplatTransform { tu, tv, tw } = splat.projected.footprint.transform;
    let (u, v) = (b.hit.u, b.hit.v);
    let at_centre = config.centre_depth_when_lowpass && !b.hit.surfel_wins();
    let mut d_uv = DVec2::ZERO;
    if b.hit.surfel_wins() {
        d_uv -= DVec2::new(u, v) * (b.gauss * d_gauss);
    } else {
        into.lowpass -= (splat.projected.footprint.lowpass_centre - pixel) * (2.0 * b.gauss * d_gauss);
    }
    if at_centre {
        into.tw.z += d_z;
    } else {
        into.tw += DVec3::new(u, v, 1.0) * d_z;
        if b.hit.surfel_wins() || !config.reference_grad {
            d_uv += DVec2::new(tw.x, tw.y) * d_z;
        }
    }
    let d_g = DVec3::new(d_uv.x, d_uv.y, -(d_uv.x * u + d_uv.y * v)) / b.hit.g_z;
    let (k, l) = (tw * pixel.x - tu, tw * pixel.y - tv);
    let (d_k, d_l) = (l.cross(d_g), d_g.cross(k));
    into.tu -= d_k;
    into.tv -= d_l;
    into.tw += d_k * pixel.x + d_l * pixel.y;
}
