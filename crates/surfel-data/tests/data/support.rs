//! A textured plane, photographed exactly, and encoders for its pictures.

use glam::{DMat3, DQuat, DVec3};
use image::{ExtendedColorType, ImageEncoder};
use std::path::Path;
use surfel_core::{Camera, Grid, Intrinsics, Rigid};
use surfel_data::{TrainingScene, TrainingView};

/// The points with `normal . point = offset`.
#[derive(Clone, Copy)]
pub struct Plane {
    pub normal: DVec3,
    pub offset: f64,
}

impl Plane {
    /// A slanted one, about 3 units in front of cameras near the origin.
    pub fn slanted() -> Self {
        Self { normal: DVec3::new(0.3, -0.2, -0.93).normalize(), offset: -2.9 }
    }

    /// z-depth along the ray of a continuous pixel.
    pub fn depth(&self, camera: &Camera, pixel: glam::DVec2) -> f64 {
        let normal = camera.camera_from_world.rotation * self.normal;
        let offset = self.offset + normal.dot(camera.camera_from_world.translation);
        offset / normal.dot(camera.ray(pixel))
    }

    /// How far a point is from the plane.
    pub fn distance(&self, point: DVec3) -> f64 {
        (self.normal.dot(point) - self.offset).abs()
    }

    /// A smooth colour that depends on the place alone.
    pub fn colour(point: DVec3) -> [f32; 3] {
        let wave = |direction: DVec3| (0.5 + 0.4 * point.dot(direction).sin()) as f32;
        [DVec3::new(2.0, 0.5, 0.0), DVec3::new(-0.5, 2.5, 0.0), DVec3::new(1.5, -1.5, 0.5)].map(wave)
    }

    pub fn photograph(&self, name: &str, camera: Camera) -> TrainingView {
        let at = |x: usize, y: usize| self.depth(&camera, Camera::pixel_centre(x, y));
        let (width, height) = (camera.width, camera.height);
        let normal = (camera.camera_from_world.rotation * self.normal).as_vec3();
        let facing = normal * -normal.dot(camera.ray(Camera::pixel_centre(width / 2, height / 2)).as_vec3()).signum();
        TrainingView {
            name: name.to_owned(),
            image: Grid::from_fn(width, height, |x, y| {
                Self::colour(camera.unproject(Camera::pixel_centre(x, y), at(x, y)))
            }),
            depth: Some(Grid::from_fn(width, height, |x, y| at(x, y) as f32)),
            normal: Some(Grid::filled(width, height, facing.to_array())),
            mask: Some(Grid::from_fn(width, height, |x, y| 3 * x > width && 4 * y < 3 * height)),
            camera,
        }
    }
}

/// A camera near the origin that looks along z, a little turned and off centre.
pub fn camera(width: usize, height: usize, which: usize) -> Camera {
    let (w, h, i) = (width as f64, height as f64, which as f64);
    Camera {
        intrinsics: Intrinsics { fx: 1.2 * w, fy: 1.25 * w, cx: 0.47 * w, cy: 0.54 * h },
        width,
        height,
        camera_from_world: Rigid::from_quat(
            DQuat::from_euler(glam::EulerRot::YXZ, 0.04 * i, -0.03, 0.02 * i),
            DVec3::new(-0.2 * i, 0.05, 0.03 * i),
        ),
    }
}

pub fn scene(contexts: Vec<TrainingView>, targets: Vec<TrainingView>) -> TrainingScene {
    TrainingScene { name: "plane".to_owned(), contexts, targets, near: 1.0, far: 9.0, unit_to_world: 1.0 }
}

fn bytes(image: &Grid<[f32; 3]>) -> Vec<u8> {
    image.as_slice().as_flattened().iter().map(|v| (255.0 * v + 0.5) as u8).collect()
}

pub fn jpeg(image: &Grid<[f32; 3]>) -> Vec<u8> {
    let mut out = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut out, 98);
    let (width, height) = (image.width() as u32, image.height() as u32);
    encoder.write_image(&bytes(image), width, height, ExtendedColorType::Rgb8).unwrap();
    out
}

pub fn png(image: &Grid<[f32; 3]>) -> Vec<u8> {
    let mut out = Vec::new();
    surfel_io::write::picture_png::write_rgb_png(&mut out, image).unwrap();
    out
}

/// 16-bit gray, depth = count * unit.
pub fn depth_png(depth: &Grid<f32>, unit: f64) -> Vec<u8> {
    let mut out = Vec::new();
    surfel_io::write::depth_png::write_depth_png(&mut out, depth, unit).unwrap();
    out
}

pub fn write(path: &Path, contents: impl AsRef<[u8]>) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, contents).unwrap();
}

pub fn write_pfm(path: &Path, map: &Grid<f32>) {
    let mut out = Vec::new();
    surfel_io::write::pfm::write_pfm(&mut out, map).unwrap();
    write(path, out);
}

/// A `cam.txt` with the intrinsics given as they are to be written.
pub fn cam_text(pose: &Rigid, [fx, fy, cx, cy]: [f64; 4], last_line: &str) -> String {
    let m: DMat3 = pose.rotation;
    let t = pose.translation;
    let row = |i: usize| format!("{} {} {} {}", m.row(i).x, m.row(i).y, m.row(i).z, t[i]);
    let (a, b, c) = (row(0), row(1), row(2));
    format!("extrinsic\n{a}\n{b}\n{c}\n0.0 0.0 0.0 1.0\n\nintrinsic\n{fx} 0 {cx}\n0 {fy} {cy}\n0 0 1\n\n{last_line}\n")
}

/// Checks that every known depth of a view lies on the plane, and that its colour is that of the place.
pub fn assert_photographs(view: &TrainingView, plane: &Plane, depth_tolerance: f64, colour_tolerance: f32) -> usize {
    let depth = view.depth.as_ref().expect("the view has depth");
    assert_eq!((view.camera.width, view.camera.height), (view.image.width(), view.image.height()));
    assert!(depth.same_size(&view.image));
    let mut known = 0;
    for y in 0..depth.height() {
        for x in 0..depth.width() {
            let pixel = Camera::pixel_centre(x, y);
            let exact = view.camera.unproject(pixel, plane.depth(&view.camera, pixel));
            let (colour, seen) = (Plane::colour(exact), view.image[(x, y)]);
            let close = colour.iter().zip(seen).all(|(a, b)| (a - b).abs() < colour_tolerance);
            assert!(close, "{} at {x}, {y}: {seen:?} instead of {colour:?}", view.name);
            if depth[(x, y)] > 0.0 {
                known += 1;
                let distance = plane.distance(view.camera.unproject(pixel, f64::from(depth[(x, y)])));
                assert!(distance < depth_tolerance, "{} at {x}, {y}: {distance} off the plane", view.name);
            }
        }
    }
    known
}
