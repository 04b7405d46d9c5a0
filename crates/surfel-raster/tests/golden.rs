//! The rasterizer and its twin against numbers computed by an independent implementation.

use serde::Deserialize;
use surfel_core::{Camera, Grid, Intrinsics, Rigid, Surfels};
use surfel_raster::twin::{self, TwinSurfels};
use surfel_raster::{MapGrads, RenderConfig, SurfelSlices, backward, forward, render};

#[derive(Deserialize)]
struct Golden {
    width: usize,
    height: usize,
    fx: f64,
    fy: f64,
    cx_index: f64,
    cy_index: f64,
    #[serde(rename = "R_w2c")]
    camera_from_world: [[f64; 3]; 3],
    #[serde(rename = "t_w2c")]
    translation: [f64; 3],
    background: [f32; 3],
    sh_degree: usize,
    means: Vec<[f32; 3]>,
    scales: Vec<[f32; 2]>,
    quats_wxyz_unnormalised: Vec<[f32; 4]>,
    opacities: Vec<f32>,
    sh: Vec<Vec<[f32; 3]>>,
    out: GoldenMaps,
    loss_weights: Vec<PixelWeights>,
    grad: GoldenGrads,
}

#[derive(Deserialize)]
struct PixelWeights {
    #[serde(rename = "C")]
    colour: [f32; 3],
    #[serde(rename = "D")]
    depth_sum: f32,
    #[serde(rename = "N")]
    normal: [f32; 3],
    #[serde(rename = "dist")]
    distortion: f32,
    #[serde(rename = "A")]
    alpha: f32,
    #[serde(rename = "med")]
    median: f32,
}

#[derive(Deserialize)]
struct GoldenGrads {
    means: Vec<[f64; 3]>,
    scales: Vec<[f64; 2]>,
    quats: Vec<[f64; 4]>,
    opacities: Vec<f64>,
    sh: Vec<Vec<[f64; 3]>>,
}

#[derive(Deserialize)]
struct GoldenMaps {
    color: Vec<[f64; 3]>,
    alpha: Vec<f64>,
    depth_sum: Vec<f64>,
    normal_view_sum: Vec<[f64; 3]>,
    median_depth: Vec<f64>,
    distortion: Vec<f64>,
}

impl Golden {
    fn load() -> Self {
        serde_json::from_str(include_str!("../fixtures/golden_raster.json")).expect("the fixture parses")
    }

    fn camera(&self) -> Camera {
        let rows = self.camera_from_world.map(glam::DVec3::from);
        let rotation = glam::DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
        Camera {
            intrinsics: Intrinsics::from_index_coordinates(self.fx, self.fy, self.cx_index, self.cy_index),
            width: self.width,
            height: self.height,
            camera_from_world: Rigid { rotation, translation: self.translation.into() },
        }
    }

    fn surfels(&self) -> Surfels {
        Surfels {
            centres: self.means.clone(),
            scales: self.scales.clone(),
            rotations: self.quats_wxyz_unnormalised.clone(),
            opacities: self.opacities.clone(),
            sh: self.sh.concat(),
            sh_degree: self.sh_degree,
        }
    }

    fn map_grads(&self) -> MapGrads {
        fn grid<T>(golden: &Golden, value: impl Fn(&PixelWeights) -> T) -> Option<Grid<T>> {
            Some(Grid::from_vec(golden.width, golden.height, golden.loss_weights.iter().map(value).collect()))
        }
        MapGrads {
            colour: grid(self, |w| w.colour),
            alpha: grid(self, |w| w.alpha),
            depth_sum: grid(self, |w| w.depth_sum),
            depth_expected: None,
            depth_median: grid(self, |w| w.median),
            normal: grid(self, |w| w.normal),
            distortion: grid(self, |w| w.distortion),
        }
    }

    fn config(&self) -> RenderConfig {
        RenderConfig { background: self.background, ..RenderConfig::default() }
    }
}

#[test]
fn forward_matches() {
    let golden = Golden::load();
    let surfels = golden.surfels();
    let maps = render(&SurfelSlices::from(&surfels), &golden.camera(), &golden.config()).expect("a sound scene");
    let twin_surfels = TwinSurfels::from(&SurfelSlices::from(&surfels));
    let twin = twin::render(&twin_surfels, &golden.camera(), &golden.config()).expect("a sound scene");
    let mut worst = 0.0f64;
    for pixel in 0..golden.width * golden.height {
        let expected = &golden.out;
        let t = &twin.as_slice()[pixel];
        let mut check = |name: &str, fast: f32, slow: f64, expected: f64| {
            worst = worst.max((f64::from(fast) - expected).abs());
            assert!((f64::from(fast) - expected).abs() < 1e-5, "{name} at {pixel}: {fast}, expected {expected}");
            assert!((slow - expected).abs() < 1e-5, "twin's {name} at {pixel}: {slow}, expected {expected}");
        };
        for c in 0..3 {
            check("colour", maps.colour.as_slice()[pixel][c], t.colour[c], expected.color[pixel][c]);
            check("normal", maps.normal.as_slice()[pixel][c], t.normal[c], expected.normal_view_sum[pixel][c]);
        }
        check("alpha", maps.alpha.as_slice()[pixel], t.alpha, expected.alpha[pixel]);
        check("depth_sum", maps.depth_sum.as_slice()[pixel], t.depth_sum, expected.depth_sum[pixel]);
        check("median", maps.depth_median.as_slice()[pixel], t.depth_median, expected.median_depth[pixel]);
        check("distortion", maps.distortion.as_slice()[pixel], t.distortion, expected.distortion[pixel]);
    }
    eprintln!("largest difference of a fast map value: {worst:.2e}");
}

#[test]
fn gradients_match() {
    let golden = Golden::load();
    let surfels = golden.surfels();
    let slices = SurfelSlices::from(&surfels);
    let (_, tape) = forward(&slices, &golden.camera(), &golden.config()).expect("a sound scene");
    let fast = backward(&slices, &tape, &golden.map_grads()).expect("a sound scene");
    let twin = twin::backward(&TwinSurfels::from(&slices), &golden.camera(), &golden.config(), &golden.map_grads())
        .expect("a sound scene");
    let expected = &golden.grad;
    let mut worst = 0.0f64;
    // Relative to the surfel's largest gradient of the same kind: a component may pass through zero.
    let mut check = |name: &str, surfel: usize, fast: &[f32], slow: &[f64], expected: &[f64]| {
        let largest = expected.iter().fold(0.0f64, |m, g| m.max(g.abs()));
        for i in 0..expected.len() {
            let error = (f64::from(fast[i]) - expected[i]).abs() / largest;
            worst = worst.max(error);
            assert!(error < 1e-3, "{name} of {surfel}: {} expected {}", fast[i], expected[i]);
            let error = (slow[i] - expected[i]).abs() / largest;
            assert!(error < 1e-4, "twin's {name} of {surfel}: {} expected {}", slow[i], expected[i]);
        }
    };
    for k in 0..surfels.len() {
        let shape = &twin.shapes[k];
        check("centre", k, &fast.centres[k], &shape.centre.to_array(), &expected.means[k]);
        check("scales", k, &fast.scales[k], &shape.scales.to_array(), &expected.scales[k]);
        check("rotation", k, &fast.rotations[k], &shape.rotation, &expected.quats[k]);
        check("opacity", k, &[fast.opacities[k]], &[shape.opacity], &[expected.opacities[k]]);
        let n = surfels.num_coefficients();
        let fast_sh = fast.sh[k * n..][..n].as_flattened();
        check("sh", k, fast_sh, twin.sh[k].as_flattened(), expected.sh[k].as_flattened());
    }
    eprintln!("largest relative difference of a fast gradient: {worst:.2e}");
}
