//! A wavy wall of surfels before a camera, in any unit.

use burn::tensor::{Device, Tensor, TensorData};
use glam::{DQuat, DVec3};
use surfel_core::{Camera, Intrinsics, Rigid, Surfels, sh};
use surfel_net::{DepthRange, RenderedMaps, SurfelTensors, render};

pub const WIDTH: usize = 24;
pub const HEIGHT: usize = 18;

pub fn camera(unit: f64) -> Camera {
    Camera {
        intrinsics: Intrinsics { fx: 26.0, fy: 25.0, cx: 12.3, cy: 8.8 },
        width: WIDTH,
        height: HEIGHT,
        camera_from_world: Rigid::from_quat(DQuat::from_rotation_y(0.1), DVec3::new(0.1, 0.0, 0.2) * unit),
    }
}

pub fn range(unit: f64) -> DepthRange {
    DepthRange { near: unit, far: 4.0 * unit }
}

pub fn surfels(unit: f64) -> Surfels {
    let camera = camera(unit);
    let mut out = Surfels { sh_degree: 0, ..Surfels::default() };
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let (a, b) = (x as f64 / WIDTH as f64, y as f64 / HEIGHT as f64);
            let depth = unit * (2.0 + 0.3 * (6.0 * a).sin() * (5.0 * b).cos());
            out.centres.push(camera.unproject(Camera::pixel_centre(x, y), depth).as_vec3().to_array());
            out.scales.push([(0.8 * depth / 26.0) as f32; 2]);
            out.rotations.push([1.0, (0.2 * (6.0 * a).cos()) as f32, (0.2 * (5.0 * b).sin()) as f32, 0.0]);
            out.opacities.push(0.7);
            out.sh.push(sh::from_colour([a as f32, b as f32, 0.5]));
        }
    }
    out
}

pub fn tensors(surfels: &Surfels) -> SurfelTensors {
    let device = &Device::flex().autodiff();
    let n = surfels.len();
    let matrix = |values: &[f32], columns: usize| -> Tensor<2> {
        Tensor::from_data(TensorData::new(values.to_vec(), [n, columns]), device)
    };
    SurfelTensors {
        centres: matrix(surfels.centres.as_flattened(), 3).require_grad(),
        scales: matrix(surfels.scales.as_flattened(), 2).require_grad(),
        rotations: matrix(surfels.rotations.as_flattened(), 4).require_grad(),
        opacities: Tensor::from_data(TensorData::new(surfels.opacities.clone(), [n]), device).require_grad(),
        sh: Tensor::from_data(TensorData::new(surfels.sh.as_flattened().to_vec(), [n, 1, 3]), device).require_grad(),
        sh_degree: 0,
    }
}

pub fn maps(surfels: &SurfelTensors, unit: f64) -> RenderedMaps {
    render(surfels, &camera(unit), &range(unit).render_config()).expect("a sound scene")
}
