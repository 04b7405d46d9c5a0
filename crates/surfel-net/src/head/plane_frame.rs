//! Refined planes as normals and tangent frames in the camera.
//!
//! A seeded network predicts rotations as turns of these frames, so a fresh one already lies in the surface.
//! Invariant: the frame's third axis is the plane's normal, turned away from the camera, and gradients flow to
//! disparity and slopes.

use burn::tensor::{Device, Tensor, TensorData};
use surfel_core::Camera;

/// Share of the squared disparity added to a squared length, so that no direction is undefined.
const FLOOR: f64 = 1e-8;

/// Unit normals `[views, 3, height, width]`, camera frame, away from the camera, of planes with `disparity`
/// (1 / scene unit) `[views, 1, height, width]` and its change per pixel `slopes` `[views, 2, height, width]`
/// (spec 2.9 with z = 1 / disparity).
pub(crate) fn normals_away(cameras: &[Camera], disparity: Tensor<4>, slopes: Tensor<4>, device: &Device) -> Tensor<4> {
    let (focal, offsets) = constants(cameras, device);
    let tangential = slopes.clone() * focal;
    let radial = disparity.clone() - (slopes * offsets).sum_dim(1);
    let normal = Tensor::cat(vec![tangential, radial], 1);
    let length = (normal.clone().powi_scalar(2).sum_dim(1) + disparity.powi_scalar(2) * FLOOR).sqrt();
    normal / length
}

/// Quaternions w x y z `[views, 4, height, width]` of the shortest turn from the viewing axis to `normals`.
pub(crate) fn frames_from_normals(normals: Tensor<4>) -> Tensor<4> {
    let [x, y, z] = [0, 1, 2].map(|axis| normals.clone().narrow(1, axis, 1));
    let turn = Tensor::cat(vec![z + 1.0, -y, x.clone(), x.zeros_like()], 1);
    let length = (turn.clone().powi_scalar(2).sum_dim(1) + FLOOR).sqrt();
    turn / length
}

/// Hamilton product `a b` of quaternions along dimension 1.
pub(super) fn product(a: Tensor<3>, b: Tensor<3>) -> Tensor<3> {
    let part = |q: &Tensor<3>, i: usize| q.clone().narrow(1, i, 1);
    let [aw, ax, ay, az] = [0, 1, 2, 3].map(|i| part(&a, i));
    let [bw, bx, by, bz] = [0, 1, 2, 3].map(|i| part(&b, i));
    let mul = |p: &Tensor<3>, q: &Tensor<3>| p.clone() * q.clone();
    Tensor::cat(
        vec![
            mul(&aw, &bw) - mul(&ax, &bx) - mul(&ay, &by) - mul(&az, &bz),
            mul(&aw, &bx) + mul(&ax, &bw) + mul(&ay, &bz) - mul(&az, &by),
            mul(&aw, &by) - mul(&ax, &bz) + mul(&ay, &bw) + mul(&az, &bx),
            mul(&aw, &bz) + mul(&ax, &by) - mul(&ay, &bx) + mul(&az, &bw),
        ],
        1,
    )
}

/// Focal lengths `[views, 2, 1, 1]` and offsets from the principal point `[views, 2, height, width]`, pixels.
fn constants(cameras: &[Camera], device: &Device) -> (Tensor<4>, Tensor<4>) {
    let (views, width, height) = (cameras.len(), cameras[0].width, cameras[0].height);
    let (mut focal, mut offsets) = (Vec::new(), Vec::with_capacity(2 * views * width * height));
    for camera in cameras {
        let centre = camera.intrinsics.principal_index();
        focal.extend([camera.intrinsics.fx as f32, camera.intrinsics.fy as f32]);
        offsets.extend((0..width * height).map(|i| ((i % width) as f64 - centre.x) as f32));
        offsets.extend((0..width * height).map(|i| ((i / width) as f64 - centre.y) as f32));
    }
    (
        Tensor::from_data(TensorData::new(focal, [views, 2, 1, 1]), device),
        Tensor::from_data(TensorData::new(offsets, [views, 2, height, width]), device),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use surfel_core::{Intrinsics, Rigid};

    #[test]
    fn a_plane_gives_its_normal_and_a_frame_in_it() {
        let intrinsics = Intrinsics { fx: 31.0, fy: 29.0, cx: 8.2, cy: 5.1 };
        let camera = Camera { intrinsics, width: 16, height: 11, camera_from_world: Rigid::IDENTITY };
        let away = DVec3::new(0.3, -0.4, 0.8).normalize();
        // away . X = 5 on the plane, hence w = away . ray / 5.
        let device = Device::flex();
        let map = |values: Vec<f32>, channels: usize| -> Tensor<4> {
            Tensor::from_data(TensorData::new(values, [1, channels, 11, 16]), &device)
        };
        let w = (0..176).map(|i| (away.dot(camera.ray(Camera::pixel_centre(i % 16, i / 16))) / 5.0) as f32).collect();
        let slope = |along: f64, focal: f64| std::iter::repeat_n((along / focal / 5.0) as f32, 176);
        let slopes = slope(away.x, intrinsics.fx).chain(slope(away.y, intrinsics.fy)).collect();
        let normals = normals_away(&[camera], map(w, 1), map(slopes, 2), &device);
        let frames = frames_from_normals(normals.clone());
        let (normals, frames) = (crate::layers::values(normals), crate::layers::values(frames));
        for i in 0..176 {
            let normal = DVec3::new(normals[i].into(), normals[176 + i].into(), normals[352 + i].into());
            assert!((normal - away).length() < 1e-5, "{normal} vs {away}");
            let q = [0, 1, 2, 3].map(|c| f64::from(frames[176 * c + i]));
            let axis = DQuat::from_xyzw(q[1], q[2], q[3], q[0]) * DVec3::Z;
            assert!((axis - away).length() < 1e-5, "{axis} vs {away}");
        }
    }
}
