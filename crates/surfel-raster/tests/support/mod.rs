//! Random scenes, and equality of pictures that may disagree where a decision tips over.

#![allow(dead_code, reason = "each test file uses its part")]

use glam::{DMat3, DQuat, DVec3};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use surfel_core::{Camera, Grid, Intrinsics, Rigid, Surfels};
use surfel_raster::twin::TwinPixel;
use surfel_raster::{MapGrads, Maps};

/// A camera with nothing symmetric about it.
pub fn camera(width: usize, height: usize) -> Camera {
    let rotation = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.2, -0.3, 0.1));
    Camera {
        intrinsics: Intrinsics {
            fx: 1.1 * width as f64,
            fy: 1.05 * width as f64,
            cx: 0.47 * width as f64,
            cy: 0.55 * height as f64,
        },
        width,
        height,
        camera_from_world: Rigid { rotation, translation: DVec3::new(0.3, -0.2, 0.5) },
    }
}

/// Surfels before the camera, from below a pixel to a fifth of the image wide, in all orientations.
pub fn surfels(camera: &Camera, count: usize, sh_degree: usize, seed: u64) -> Surfels {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut out = Surfels { sh_degree, ..Surfels::default() };
    for _ in 0..count {
        let pixel = glam::DVec2::new(
            rng.random_range(-0.05..1.05) * camera.width as f64,
            rng.random_range(-0.05..1.05) * camera.height as f64,
        );
        let depth = rng.random_range(1.0..4.0);
        let pixel_size = depth / camera.intrinsics.fx;
        let widest = (0.1 * camera.width as f64).max(2.0);
        let scale = |rng: &mut StdRng| (pixel_size * 0.2 * (widest / 0.2).powf(rng.random_range(0.0..1.0))) as f32;
        out.centres.push(camera.unproject(pixel, depth).as_vec3().to_array());
        out.scales.push([scale(&mut rng), scale(&mut rng)]);
        out.rotations.push(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        out.opacities.push(rng.random_range(0.05..0.999));
        for n in 0..out.num_coefficients() {
            let reach = if n == 0 { 1.5 } else { 0.4 };
            out.sh.push(std::array::from_fn(|_| rng.random_range(-reach..reach)));
        }
    }
    out
}

/// A random linear loss on every map.
pub fn map_grads(width: usize, height: usize, seed: u64) -> MapGrads {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut scalar = || Some(Grid::from_fn(width, height, |_, _| rng.random_range(-1.0..1.0f32)));
    let (alpha, depth_sum, depth_expected) = (scalar(), scalar(), scalar());
    let (depth_median, distortion) = (scalar(), scalar());
    let mut vector =
        || Some(Grid::from_fn(width, height, |_, _| std::array::from_fn(|_| rng.random_range(-1.0..1.0f32))));
    MapGrads { colour: vector(), alpha, depth_sum, depth_expected, depth_median, normal: vector(), distortion }
}

/// The value of that loss on the twin's pixels.
pub fn loss(pixels: &Grid<TwinPixel>, grads: &MapGrads) -> f64 {
    fn scalar(map: &Option<Grid<f32>>, i: usize, value: f64) -> f64 {
        map.as_ref().map_or(0.0, |grid| f64::from(grid.as_slice()[i]) * value)
    }
    fn vector(map: &Option<Grid<[f32; 3]>>, i: usize, value: [f64; 3]) -> f64 {
        map.as_ref().map_or(0.0, |grid| (0..3).map(|c| f64::from(grid.as_slice()[i][c]) * value[c]).sum())
    }
    let of_pixel = |(i, p): (usize, &TwinPixel)| {
        vector(&grads.colour, i, p.colour)
            + scalar(&grads.alpha, i, p.alpha)
            + scalar(&grads.depth_sum, i, p.depth_sum)
            + scalar(&grads.depth_expected, i, p.depth_expected())
            + scalar(&grads.depth_median, i, p.depth_median)
            + vector(&grads.normal, i, p.normal)
            + scalar(&grads.distortion, i, p.distortion)
    };
    pixels.as_slice().iter().enumerate().map(of_pixel).sum()
}

/// How far apart two pictures may be.
#[derive(Clone, Copy)]
pub struct Tolerance {
    /// Per map value, relative to the larger of 1 and the value.
    pub value: f64,
    /// Pixels whose twin came this close to another decision are the border.
    pub margin: f64,
    /// Share of border pixels that may differ by more than `value`.
    pub border_share: f64,
}

/// What a comparison found.
#[derive(Debug, Default, PartialEq)]
pub struct Difference {
    /// Largest difference off the border.
    pub interior: f64,
    /// Border pixels beyond the tolerance.
    pub border_off: usize,
    /// Border pixels.
    pub border: usize,
}

/// Compares a fast picture to the twin's. Off the border every value must agree; on it, where rounding
/// may tip a decision, all but a counted share must.
pub fn compare(maps: &Maps, twin: &Grid<TwinPixel>, tolerance: Tolerance) -> Result<Difference, String> {
    let mut out = Difference::default();
    for (i, slow) in twin.as_slice().iter().enumerate() {
        let (name, difference) = worst(maps, i, slow);
        if slow.margin >= tolerance.margin {
            out.interior = out.interior.max(difference);
            if difference.is_nan() || difference > tolerance.value {
                return Err(format!("{name} at pixel {i} differs by {difference:.2e} off the border"));
            }
        } else {
            out.border += 1;
            out.border_off += usize::from(difference.is_nan() || difference > tolerance.value);
        }
    }
    let allowed = (tolerance.border_share * out.border as f64).ceil() as usize;
    if out.border_off > allowed {
        return Err(format!("{} of {} border pixels differ, {allowed} may", out.border_off, out.border));
    }
    Ok(out)
}

fn worst(maps: &Maps, i: usize, slow: &TwinPixel) -> (&'static str, f64) {
    let mut pairs = vec![
        ("alpha", maps.alpha.as_slice()[i], slow.alpha),
        ("depth_sum", maps.depth_sum.as_slice()[i], slow.depth_sum),
        ("depth_expected", maps.depth_expected.as_slice()[i], slow.depth_expected()),
        ("depth_median", maps.depth_median.as_slice()[i], slow.depth_median),
        ("distortion", maps.distortion.as_slice()[i], slow.distortion),
        ("num_contributors", maps.num_contributors.as_slice()[i] as f32, f64::from(slow.num_contributors)),
    ];
    for c in 0..3 {
        pairs.push(("colour", maps.colour.as_slice()[i][c], slow.colour[c]));
        pairs.push(("normal", maps.normal.as_slice()[i][c], slow.normal[c]));
    }
    let difference = |fast: f32, slow: f64| (f64::from(fast) - slow).abs() / slow.abs().max(1.0);
    pairs
        .into_iter()
        .map(|(name, fast, slow)| (name, difference(fast, slow)))
        .fold(("", 0.0), |a, b| if b.1.is_nan() || b.1 > a.1 { b } else { a })
}
