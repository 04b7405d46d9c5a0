//! Normals of surfels as the cameras of their own views see them.
//!
//! Invariant: every normal faces its camera, as true normals do; which side that is carries no gradient.

use crate::sample::Sample;
use burn::tensor::{Device, Tensor, TensorData};
use surfel_core::Camera;
use surfel_net::SurfelTensors;

/// Unit normals `[views * height * width, 3]` in the camera of the view that each surfel belongs to, facing it.
pub(crate) fn facing(surfels: &SurfelTensors, sample: &Sample, device: &Device) -> Tensor<2> {
    let [w, x, y, z] = [0, 1, 2, 3].map(|i| surfels.rotations.clone().narrow(1, i, 1));
    let mul = |a: &Tensor<2>, b: &Tensor<2>| a.clone() * b.clone();
    let world = Tensor::cat(
        vec![
            (mul(&x, &z) + mul(&w, &y)) * 2.0,
            (mul(&y, &z) - mul(&w, &x)) * 2.0,
            (mul(&x, &x) + mul(&y, &y)) * -2.0 + 1.0,
        ],
        1,
    );
    let (views, pixels) = (sample.num_views(), sample.num_pixels());
    // Columns of `camera_from_world` one after the other are its transpose, row by row, as row vectors need it.
    let columns = sample.cameras.iter().flat_map(|camera| camera.camera_from_world.rotation.to_cols_array());
    let transposed: Vec<f32> = columns.map(|value| value as f32).collect();
    let transposed: Tensor<3> = Tensor::from_data(TensorData::new(transposed, [views, 3, 3]), device);
    let in_camera = world.reshape([views, pixels, 3]).matmul(transposed);
    let rays: Vec<f32> = sample
        .cameras
        .iter()
        .flat_map(|camera| {
            let pixels = (0..pixels).map(|i| Camera::pixel_centre(i % camera.width, i / camera.width));
            pixels.flat_map(|pixel| camera.ray(pixel).as_vec3().to_array()).collect::<Vec<_>>()
        })
        .collect();
    let rays: Tensor<3> = Tensor::from_data(TensorData::new(rays, [views, pixels, 3]), device);
    let away = (in_camera.clone().detach() * rays).sum_dim(2).greater_elem(0.0).float();
    let sign = away * -2.0 + 1.0;
    (in_camera * sign).reshape([views * pixels, 3])
}
