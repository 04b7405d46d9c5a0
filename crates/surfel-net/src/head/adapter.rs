//! Raw attributes and depth to surfels in the world (spec 2.7.2).
//!
//! Invariant: moving, turning or scaling the scene moves, turns or scales the surfels (colours turn with it).

use super::SurfelTensors;
use super::attributes::NUM_SHAPE;
use super::plane_frame::product;
use crate::config::HeadConfig;
use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Tensor, TensorData};
use glam::DQuat;
use surfel_core::Camera;
use surfel_core::sh::{self, ShRotation};

/// What a seeded network's attributes are relative to.
#[derive(Clone)]
pub(crate) struct Base {
    /// Tangent frames, quaternions w x y z in the camera, `[views, 4, height, width]`.
    pub(crate) frames: Tensor<4>,
    /// sRGB of the pixels, `[views, 3, height, width]`.
    pub(crate) colours: Tensor<4>,
}

/// What the adapter needs of the cameras, as tensors.
pub(crate) struct Adapter {
    /// World direction of each pixel centre's ray with unit z-depth, `[views, 3, pixels]`.
    rays: Tensor<3>,
    /// Camera centres, `[views, 3, 1]`.
    centres: Tensor<3>,
    /// Left multiplication by the `world_from_camera` quaternion, `[views, 4, 4]`.
    quaternion_products: Tensor<3>,
    /// Scale of one unit of footprint at unit depth, `[views, 1, 1]` (spec 1.7, `m`).
    footprints: Tensor<3>,
    /// Rotation of SH coefficients to the world with the factor of each degree, `[views, 1, n, n]`.
    sh_rotations: Tensor<4>,
    config: HeadConfig,
}

impl Adapter {
    pub(crate) fn new(cameras: &[Camera], config: &HeadConfig, device: &Device) -> Self {
        let views = cameras.len();
        let (width, height) = (cameras[0].width, cameras[0].height);
        let num_sh = sh::num_coefficients(config.sh_degree);
        let (mut rays, mut centres, mut footprints) = (Vec::new(), Vec::new(), Vec::new());
        let (mut products, mut sh_rotations) = (Vec::new(), Vec::new());
        for camera in cameras {
            let world_from_camera = camera.camera_from_world.inverse();
            let directions: Vec<_> = (0..width * height)
                .map(|i| world_from_camera.rotation * camera.ray(Camera::pixel_centre(i % width, i / width)))
                .collect();
            rays.extend((0..3).flat_map(|axis| directions.iter().map(move |d| d[axis] as f32)));
            centres.extend(world_from_camera.translation.as_vec3().to_array());
            footprints.push((0.1 * (1.0 / camera.intrinsics.fx + 1.0 / camera.intrinsics.fy)) as f32);
            let q = DQuat::from_mat3(&world_from_camera.rotation);
            let (w, x, y, z) = (q.w as f32, q.x as f32, q.y as f32, q.z as f32);
            products.extend([w, -x, -y, -z, x, w, -z, y, y, z, w, -x, z, -y, x, w]);
            sh_rotations.extend(sh_matrix(&ShRotation::new(world_from_camera.rotation), num_sh));
        }
        let tensor = |values: Vec<f32>, shape: [usize; 3]| Tensor::from_data(TensorData::new(values, shape), device);
        Self {
            rays: tensor(rays, [views, 3, width * height]),
            centres: tensor(centres, [views, 3, 1]),
            quaternion_products: tensor(products, [views, 4, 4]),
            footprints: tensor(footprints, [views, 1, 1]),
            sh_rotations: tensor(sh_rotations, [views, num_sh, num_sh]).unsqueeze_dim(1),
            config: config.clone(),
        }
    }

    /// Surfels of raw attributes `[views, outputs, height, width]`, z-depth and opacity `[views, 1, height, width]`;
    /// with a base, rotations are turns of its frames and colours corrections of its colours.
    pub(crate) fn forward(
        &self,
        attributes: Tensor<4>,
        depth: Tensor<4>,
        opacity: Tensor<4>,
        base: Option<&Base>,
    ) -> SurfelTensors {
        let [views, outputs, height, width] = attributes.dims();
        let pixels = height * width;
        let attributes: Tensor<3> = attributes.reshape([views, outputs, pixels]);
        let depth: Tensor<3> = depth.reshape([views, 1, pixels]);
        let centres = self.rays.clone() * depth.clone() + self.centres.clone();

        let HeadConfig { scale_min, scale_max, sh_degree, .. } = self.config;
        let footprint = sigmoid(attributes.clone().narrow(1, 0, 2)) * (scale_max - scale_min) + scale_min;
        let scales = footprint * depth * self.footprints.clone();

        let in_camera = attributes.clone().narrow(1, 2, 4);
        let length = (in_camera.clone().powi_scalar(2).sum_dim(1) + 1e-8).sqrt();
        let turn = in_camera / length;
        let in_camera = match base {
            Some(base) => product(base.frames.clone().reshape([views, 4, pixels]), turn),
            None => turn,
        };
        let rotations = self.quaternion_products.clone().matmul(in_camera);

        let num_sh = sh::num_coefficients(sh_degree);
        let mut in_camera: Tensor<4> = attributes.narrow(1, NUM_SHAPE, 3 * num_sh).reshape([views, 3, num_sh, pixels]);
        if let Some(base) = base {
            let constant = (base.colours.clone() - 0.5) / sh::C0;
            let constant: Tensor<4> = constant.reshape([views, 3, 1, pixels]) + in_camera.clone().narrow(2, 0, 1);
            let others = (num_sh > 1).then(|| in_camera.narrow(2, 1, num_sh - 1));
            in_camera = Tensor::cat(std::iter::once(constant).chain(others).collect(), 2);
        }
        let rotated = self.sh_rotations.clone().matmul(in_camera);
        let per_surfel = |t: Tensor<3>| {
            let channels = t.dims()[1];
            t.swap_dims(1, 2).reshape([views * pixels, channels])
        };
        SurfelTensors {
            centres: per_surfel(centres),
            scales: per_surfel(scales),
            rotations: per_surfel(rotations),
            opacities: opacity.reshape([views * pixels]),
            sh: rotated.permute([0, 3, 2, 1]).reshape([views * pixels, num_sh, 3]),
            sh_degree,
        }
    }
}

/// The rotation as a row-major matrix, with each degree damped (spec 1.5: 1, then `0.1 * 0.25^l`).
fn sh_matrix(rotation: &ShRotation, num_sh: usize) -> Vec<f32> {
    let mut matrix = vec![0.0; num_sh * num_sh];
    for column in 0..num_sh {
        let degree = column.isqrt() as i32;
        let mut unit = vec![0.0; num_sh];
        unit[column] = if degree == 0 { 1.0 } else { 0.1 * 0.25f64.powi(degree) };
        rotation.apply(&mut unit);
        for row in 0..num_sh {
            matrix[row * num_sh + column] = unit[row] as f32;
        }
    }
    matrix
}
