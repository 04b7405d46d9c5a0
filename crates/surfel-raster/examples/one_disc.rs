//! Renders one disc, then asks how the area it covers grows with its two scales.

use surfel_core::{Camera, Grid, Intrinsics, Rigid, Surfels, sh};
use surfel_raster::{MapGrads, RenderConfig, SurfelSlices, backward, forward};

fn main() -> Result<(), surfel_raster::RasterError> {
    let (width, height) = (48, 24);
    let camera = Camera {
        intrinsics: Intrinsics { fx: 40.0, fy: 24.0, cx: 24.0, cy: 12.0 },
        width,
        height,
        camera_from_world: Rigid::IDENTITY,
    };
    // Two scene units away, turned by a third of a right angle about the vertical.
    let disc = Surfels {
        centres: vec![[0.0, 0.0, 2.0]],
        scales: vec![[0.4, 0.4]],
        rotations: vec![[0.966, 0.0, 0.259, 0.0]],
        opacities: vec![0.9],
        sh: vec![sh::from_colour([0.9, 0.6, 0.2])],
        sh_degree: 0,
    };
    let surfels = SurfelSlices::from(&disc);
    let (maps, tape) = forward(&surfels, &camera, &RenderConfig::default())?;
    for y in 0..height {
        let shade = |&alpha: &f32| char::from(b" .:-=+*#%@"[(alpha * 9.9) as usize]);
        println!("{}", maps.alpha.row(y).iter().map(shade).collect::<String>());
    }
    println!("depth in the middle: {:.3}", maps.depth_median[(width / 2, height / 2)]);

    let everywhere = MapGrads { alpha: Some(Grid::filled(width, height, 1.0)), ..MapGrads::default() };
    let grads = backward(&surfels, &tape, &everywhere)?;
    println!("covered area grows by {:.1?} pixels per unit of scale", grads.scales[0]);
    Ok(())
}
