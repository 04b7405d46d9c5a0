//! Analytic scenes written down as people have them: a folder of photographs and a camera file.
//!
//! Written from the description of our `cameras.json` and not with the product's writer, so that both must be
//! right. The world's origin and axes are arbitrary: cameras on a circle about the origin would make several
//! camera mistakes look alike.

use glam::{DMat4, DVec3};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::OnceLock;
use surfel_core::{Camera, Grid};
use surfel_synth::{RenderedView, SceneKind, SceneOptions};

/// What all tests photograph, unless they say otherwise.
pub fn options(kind: SceneKind) -> SceneOptions {
    SceneOptions { kind, width: 160, height: 128, num_views: 3, ..SceneOptions::default() }
}

/// Three photographs of a rolling height field, in an arbitrary world.
pub fn height_field() -> &'static [RenderedView] {
    static VIEWS: OnceLock<Vec<RenderedView>> = OnceLock::new();
    VIEWS.get_or_init(|| photographed(&options(SceneKind::HeightField)))
}

/// Three photographs of a sphere on a plane, in an arbitrary world.
pub fn sphere() -> &'static [RenderedView] {
    static VIEWS: OnceLock<Vec<RenderedView>> = OnceLock::new();
    VIEWS.get_or_init(|| photographed(&options(SceneKind::Sphere)))
}

/// The world of [`photographed`] cameras as seen from the one the scene was made in.
pub fn world_from_synth() -> surfel_core::Rigid {
    surfel_synth::look_at(DVec3::new(310.0, -170.0, 120.0), DVec3::new(-40.0, 90.0, 60.0)).inverse()
}

fn photographed(options: &SceneOptions) -> Vec<RenderedView> {
    let synth_from_world = world_from_synth().inverse();
    let mut views = options.render();
    for rendered in &mut views {
        let camera = &mut rendered.view.camera;
        camera.camera_from_world = camera.camera_from_world * synth_from_world;
    }
    views
}

/// `images/00.png`, `images/01.png`, ...
pub fn image_name(index: usize) -> String {
    format!("images/{index:02}.png")
}

/// The photographs and `cameras.json` of these views.
pub fn write_scene(folder: &Path, views: &[RenderedView]) {
    write_photographs(folder, views);
    write_cameras(folder, views, |camera| camera);
}

/// The photographs, 8 bits a channel.
pub fn write_photographs(folder: &Path, views: &[RenderedView]) {
    for (index, rendered) in views.iter().enumerate() {
        write_png(&folder.join(image_name(index)), &rendered.view.image);
    }
}

/// `cameras.json`, each camera changed by `edit`; the stated image size stays that of the photographs.
pub fn write_cameras(folder: &Path, views: &[RenderedView], edit: impl Fn(Camera) -> Camera) {
    let cameras: Vec<Camera> = views.iter().map(|rendered| edit(rendered.view.camera)).collect();
    write_json(&folder.join("cameras.json"), &camera_entries(&cameras));
}

/// The content of a `cameras.json`.
pub fn camera_entries(cameras: &[Camera]) -> Value {
    let entry = |(index, camera): (usize, &Camera)| {
        let k = camera.intrinsics;
        let pose = rows(camera.camera_from_world.to_mat4());
        json!({
            "image": image_name(index), "width": camera.width, "height": camera.height,
            "K": [[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]],
            "camera_from_world": pose,
        })
    };
    cameras.iter().enumerate().map(entry).collect()
}

/// The rows of a matrix.
pub fn rows(matrix: DMat4) -> [[f64; 4]; 4] {
    [0, 1, 2, 3].map(|row| matrix.row(row).to_array())
}

/// Writes a JSON file.
pub fn write_json(path: &Path, value: &Value) {
    write(path, value.to_string());
}

/// Reads a JSON file.
pub fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// Writes a file and the folders above it.
pub fn write(path: &Path, bytes: impl AsRef<[u8]>) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

/// Writes sRGB values in \[0, 1\] as a PNG.
pub fn write_png(path: &Path, picture: &Grid<[f32; 3]>) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let byte = |value: f32| (value * 255.0).round() as u8;
    let (width, height) = (picture.width() as u32, picture.height() as u32);
    let pixel = |x: u32, y: u32| image::Rgb(picture[(x as usize, y as usize)].map(byte));
    image::RgbImage::from_fn(width, height, pixel).save(path).unwrap();
}
