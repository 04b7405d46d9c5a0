//! Analytic scenes written down as each set is.

use std::fmt::Write as _;
use std::fs::File;
use std::path::Path;
use surfel_core::{Camera, Grid};
use surfel_io::write::{pfm::write_pfm, picture_png::write_rgb_png};
use surfel_synth::{RenderedView, SceneKind, SceneOptions};
use surfel_torch::{Dtype, Object, Tensor};

/// Of every photograph; also what DTU's cameras are for.
const SIZE: (usize, usize) = (160, 128);
/// Rows of depth that nobody measured.
const UNMEASURED_ROWS: usize = 60;

/// A walk about a scene, in millimetres and DTU's proportions.
fn views(seed: u64, num_views: usize) -> Vec<RenderedView> {
    let (width, height) = SIZE;
    let kind = SceneKind::Boxes;
    SceneOptions { kind, seed, width, height, num_views, pair_angle_deg: 6.0, ..SceneOptions::default() }.render()
}

fn write(path: &Path, contents: impl AsRef<[u8]>) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, contents).unwrap();
}

fn png(image: &Grid<[f32; 3]>) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_rgb_png(&mut bytes, image).unwrap();
    bytes
}

fn jpeg(image: &Grid<[f32; 3]>) -> Vec<u8> {
    let colours: Vec<u8> = image.as_slice().as_flattened().iter().map(|c| (255.0 * c + 0.5) as u8).collect();
    let picture = image::RgbImage::from_raw(SIZE.0 as u32, SIZE.1 as u32, colours).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Jpeg).unwrap();
    bytes.into_inner()
}

/// Depth with a hole at its top.
fn pfm(depth: &Grid<f32>) -> Vec<u8> {
    let measured = Grid::from_fn(SIZE.0, SIZE.1, |x, y| if y < UNMEASURED_ROWS { 0.0 } else { depth[(x, y)] });
    let mut bytes = Vec::new();
    write_pfm(&mut bytes, &measured).unwrap();
    bytes
}

/// A `cam.txt`, whose first pixel centre is at 0 but for `origin`.
fn cam_text(camera: &Camera, origin: f64, range: &str) -> String {
    let (k, pose) = (camera.intrinsics, camera.camera_from_world);
    let row = |i: usize| {
        format!(
            "{} {} {} {}",
            pose.rotation.row(i).x,
            pose.rotation.row(i).y,
            pose.rotation.row(i).z,
            pose.translation[i]
        )
    };
    let rows = [0, 1, 2].map(row).join("\n");
    let (cx, cy) = (k.cx - origin, k.cy - origin);
    format!("extrinsic\n{rows}\n0 0 0 1\n\nintrinsic\n{} 0 {cx}\n0 {} {cy}\n0 0 1\n\n{range}\n", k.fx, k.fy)
}

/// Every view with all others, nearest first.
fn pair_text(num_views: usize) -> String {
    let mut text = format!("{num_views}\n");
    for view in 0..num_views {
        let mut others: Vec<usize> = (0..num_views).filter(|other| *other != view).collect();
        others.sort_by_key(|other| other.abs_diff(view));
        let scored: Vec<String> =
            others.iter().map(|other| format!("{other} {}", 100 - other.abs_diff(view))).collect();
        writeln!(text, "{view}\n{} {}", others.len(), scored.join(" ")).unwrap();
    }
    text
}

/// Chunks of clips, one scene of every length in `lengths`.
pub fn clips(root: &Path, lengths: &[usize]) {
    let key = |scene: usize| format!("clip{scene}");
    let scenes = lengths.iter().enumerate().map(|(scene, length)| clip(&key(scene), &views(scene as u64, *length)));
    std::fs::create_dir_all(root).unwrap();
    surfel_torch::write(&Object::List(scenes.collect()), File::create(root.join("000000.torch")).unwrap()).unwrap();
    let index: Vec<String> = (0..lengths.len()).map(|scene| format!("\"{}\": \"000000.torch\"", key(scene))).collect();
    write(&root.join("index.json"), format!("{{{}}}", index.join(",")));
}

fn clip(key: &str, views: &[RenderedView]) -> Object {
    /// Clips are measured in units of their own; theirs begin at depth 1.
    const UNIT: f64 = 200.0;
    let row = |view: &RenderedView| {
        let (k, pose) = (view.view.camera.intrinsics, view.view.camera.camera_from_world);
        let (w, h) = (SIZE.0 as f64, SIZE.1 as f64);
        let mut row = vec![k.fx / w, k.fy / h, k.cx / w, k.cy / h, 0.0, 0.0];
        for i in 0..3 {
            row.extend(pose.rotation.row(i).to_array());
            row.push(pose.translation[i] / UNIT);
        }
        row.into_iter().map(|v| v as f32).collect::<Vec<_>>()
    };
    let rows: Vec<f32> = views.iter().flat_map(row).collect();
    let image = |view: &RenderedView| {
        let bytes = png(&view.view.image);
        Object::Tensor(Tensor::from_bytes(Dtype::U8, vec![bytes.len()], bytes))
    };
    Object::Dict(vec![
        ("key".to_owned(), Object::Str(key.to_owned())),
        ("cameras".to_owned(), Object::Tensor(Tensor::from_f32(vec![views.len(), 18], &rows))),
        ("images".to_owned(), Object::List(views.iter().map(image).collect())),
    ])
}

/// DTU with scans 1, which is trained on, 2, which is measured on, and 24, which is neither.
pub fn dtu(root: &Path, num_views: usize) {
    for scan in [1, 2, 24] {
        for (id, view) in views(scan, num_views).iter().enumerate() {
            let image = png(&view.view.image);
            write(&root.join(format!("Rectified/scan{scan}_train/rect_{:03}_3_r5000.png", id + 1)), image);
            let depths = root.join(format!("Depths/scan{scan}_train"));
            write(&depths.join(format!("depth_map_{id:04}.pfm")), pfm(&view.depth));
            write(&depths.join(format!("depth_visual_{id:04}.png")), png(&Grid::filled(SIZE.0, SIZE.1, [1.0; 3])));
            let camera = cam_text(&view.view.camera, 0.5 / 8.0, "425.0 2.5");
            write(&root.join(format!("Cameras/train/{id:08}_cam.txt")), camera);
        }
    }
    write(&root.join("Cameras/pair.txt"), pair_text(num_views));
}

/// BlendedMVS with scenes "a" and "b", and a list of the first alone.
pub fn blended_mvs(root: &Path, num_views: usize) {
    for (seed, name) in ["a", "b"].into_iter().enumerate() {
        let scene = root.join(name);
        for (id, view) in views(seed as u64, num_views).iter().enumerate() {
            write(&scene.join(format!("blended_images/{id:08}.jpg")), jpeg(&view.view.image));
            write(&scene.join(format!("rendered_depth_maps/{id:08}.pfm")), pfm(&view.depth));
            let camera = cam_text(&view.view.camera, 0.5, "425.0 2.5 192 905.0");
            write(&scene.join(format!("cams/{id:08}_cam.txt")), camera);
        }
        write(&scene.join("cams/pair.txt"), pair_text(num_views));
    }
    write(&root.join("list.txt"), "a\n");
}
