//! The surface is where it really is: reconstructions of analytic scenes against their exact depth.

use crate::command::{SIZE, reconstruct};
use crate::read_back::{share_within, vertices};
use crate::scene_files::{
    height_field, image_name, options, rows, sphere, world_from_synth, write_json, write_photographs, write_png,
    write_scene,
};
use glam::{DMat4, DVec2, DVec3, DVec4};
use serde_json::json;
use std::path::Path;
use surfel_core::{Camera, Grid};
use surfel_io::depth::read_pfm;
use surfel_synth::{RenderedView, SceneKind};

/// Reconstructs `views` and returns the share of pixels of each within 1 % of the exact depth.
fn shares(folder: &Path, views: &[RenderedView]) -> Vec<f64> {
    let (scene, out) = (folder.join("scene"), folder.join("out"));
    write_scene(&scene, views);
    let count = views.len().to_string();
    reconstruct(&scene, &out, &["--size", SIZE, "--num-views", &count]).succeeded("reconstruct");
    let share = |(index, rendered): (usize, &RenderedView)| {
        let depth = read_pfm(&out.join(format!("depth/{index:02}.pfm"))).unwrap();
        share_within(&depth, &rendered.depth, 0.01)
    };
    views.iter().enumerate().map(share).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn depth_is_right_to_a_percent_and_a_third_view_does_no_harm() {
    for (what, views) in [("height field", height_field()), ("sphere", sphere())] {
        let (two, three) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let (two, three) = (shares(two.path(), &views[..2]), shares(three.path(), views));
        println!("{what}: {two:.3?} of two views, {three:.3?} of three");
        assert!(two.iter().all(|share| *share >= 0.85), "{what}: {two:?}");
        // Like with like: the views that both runs have.
        assert!(mean(&three[..2]) >= mean(&two) - 0.01, "{what}: {three:?} of three views, {two:?} of two");
    }
}

#[test]
fn the_mesh_of_a_sphere_has_its_radius() {
    let folder = tempfile::tempdir().unwrap();
    let views = &sphere()[..2];
    shares(folder.path(), views);
    let radius = options(SceneKind::Sphere).object_radius;
    let centre = world_from_synth().transform(DVec3::ZERO);
    let (camera, object) = (&views[0].view.camera, views[0].object_mask());
    let is_object = |p: &DVec3| {
        let Some((pixel, _)) = camera.project(*p) else { return false };
        let (x, y) = (pixel.x.floor() as isize, pixel.y.floor() as isize);
        // Off the silhouette, where a vertex may belong to the ground.
        [(0, 0), (4, 0), (-4, 0), (0, 4), (0, -4)].iter().all(|(dx, dy)| object.get(x + dx, y + dy) == Some(&true))
    };
    let on_sphere: Vec<DVec3> = vertices(&folder.path().join("out/mesh.ply")).into_iter().filter(is_object).collect();
    let mut radii: Vec<f64> = on_sphere.iter().map(|p| p.distance(centre) / radius).collect();
    radii.sort_by(f64::total_cmp);
    let quantile = |q: f64| radii[(q * radii.len() as f64) as usize];
    println!(
        "{} vertices on the sphere, radius {:.4} (5 % {:.4}, 95 % {:.4})",
        radii.len(),
        quantile(0.5),
        quantile(0.05),
        quantile(0.95)
    );
    assert!(radii.len() > 2000 && (quantile(0.5) - 1.0).abs() < 0.01);
    assert!(quantile(0.05) > 0.97 && quantile(0.95) < 1.03);
}

/// The picture a lens with radial distortion `k1` takes, from a larger one without.
fn distorted(pinhole: &RenderedView, camera: &Camera, k1: f64) -> Grid<[f32; 3]> {
    let large = &pinhole.view;
    Grid::from_fn(camera.width, camera.height, |x, y| {
        let seen = camera.ray(Camera::pixel_centre(x, y)).truncate();
        let mut ideal = seen;
        for _ in 0..30 {
            ideal = seen / (1.0 + k1 * ideal.length_squared());
        }
        let (pixel, _) = Camera { camera_from_world: surfel_core::Rigid::IDENTITY, ..large.camera }
            .project(ideal.extend(1.0))
            .expect("in front");
        bilinear(&large.image, pixel - DVec2::splat(0.5))
    })
}

fn bilinear(image: &Grid<[f32; 3]>, at: DVec2) -> [f32; 3] {
    let corner = at.floor();
    let weight = (at - corner).as_vec2();
    let get = |dx: isize, dy: isize| {
        let (x, y) = (corner.x as isize + dx, corner.y as isize + dy);
        image[(x.clamp(0, image.width() as isize - 1) as usize, y.clamp(0, image.height() as isize - 1) as usize)]
    };
    let corners = [get(0, 0), get(1, 0), get(0, 1), get(1, 1)];
    std::array::from_fn(|c| {
        let [a, b, d, e] = corners.map(|pixel| pixel[c]);
        (a * (1.0 - weight.x) + b * weight.x) * (1.0 - weight.y) + (d * (1.0 - weight.x) + e * weight.x) * weight.y
    })
}

/// `transforms.json` as nerfstudio writes it: camera-to-world, OpenGL axes, OpenCV distortion.
fn write_transforms(folder: &Path, cameras: &[Camera], k1: f64) {
    let camera = cameras[0];
    let k = camera.intrinsics;
    let frame = |(index, camera): (usize, &Camera)| {
        let opengl =
            camera.camera_from_world.inverse().to_mat4() * DMat4::from_diagonal(DVec4::new(1.0, -1.0, -1.0, 1.0));
        json!({ "file_path": image_name(index), "transform_matrix": rows(opengl) })
    };
    let frames: Vec<_> = cameras.iter().enumerate().map(frame).collect();
    let file = json!({
        "camera_model": "OPENCV", "w": camera.width, "h": camera.height, "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy,
        "k1": k1, "k2": 0.0, "p1": 0.0, "p2": 0.0, "frames": frames,
    });
    write_json(&folder.join("transforms.json"), &file);
}

#[test]
fn a_distorting_lens_and_another_format_give_the_same_surface() {
    // A strong phone lens. (Far stronger ones cost sharpness at the rim, which no undistortion gives back.)
    const K1: f64 = -0.1;
    let options = options(SceneKind::HeightField);
    let (scene, cameras) = (options.scene(), &options.cameras()[..2]);
    let folder = tempfile::tempdir().unwrap();
    let (root, out) = (folder.path().join("scene"), folder.path().join("out"));
    for (index, camera) in cameras.iter().enumerate() {
        // Twice as fine, and wider, because the lens sees more than the pinhole.
        let wide = camera.cropped(-40, -32, 240, 192).resized(480, 384);
        let pinhole = scene.render(&wide, "wide", &surfel_synth::RenderOptions::default());
        write_png(&root.join(image_name(index)), &distorted(&pinhole, camera, K1));
    }
    write_transforms(&root, cameras, K1);
    reconstruct(&root, &out, &["--size", SIZE]).succeeded("reconstruct");
    let working = crate::read_back::read_cameras(&out.join("cameras.json"));
    let truth: Vec<RenderedView> =
        working.iter().map(|camera| scene.render(camera, "truth", &surfel_synth::RenderOptions::default())).collect();
    // The same field of view, and the same empty corners, without a lens to undo.
    let plain = tempfile::tempdir().unwrap();
    let (plain_root, plain_out) = (plain.path().join("scene"), plain.path().join("out"));
    write_scene(&plain_root, &truth);
    std::fs::create_dir_all(plain_root.join("masks")).unwrap();
    for index in 0..truth.len() {
        let seen = read_pfm(&out.join(format!("depth/{index:02}.pfm"))).unwrap();
        let mask = image::GrayImage::from_fn(seen.width() as u32, seen.height() as u32, |x, y| {
            image::Luma([if seen[(x as usize, y as usize)] > 0.0 { 255 } else { 0 }])
        });
        mask.save(plain_root.join(format!("masks/{index:02}.png"))).unwrap();
    }
    reconstruct(&plain_root, &plain_out, &["--size", SIZE]).succeeded("reconstruct");
    for (index, truth) in truth.iter().enumerate() {
        let depth_in = |out: &Path| read_pfm(&out.join(format!("depth/{index:02}.pfm"))).unwrap();
        let (depth, plain) = (depth_in(&out), depth_in(&plain_out));
        // The working picture covers all the lens saw, and its corners more than that: those stay empty.
        let seen = Grid::from_fn(depth.width(), depth.height(), |x, y| match depth[(x, y)] > 0.0 {
            true => truth.depth[(x, y)],
            false => 0.0,
        });
        let coverage = seen.as_slice().iter().filter(|z| **z > 0.0).count() as f64 / seen.len() as f64;
        let (share, without_lens) = (share_within(&depth, &seen, 0.01), share_within(&plain, &seen, 0.01));
        println!("view {index}: {coverage:.3} seen, {share:.3} within 1 %, {without_lens:.3} without the lens");
        assert!(coverage > 0.7, "view {index}: {coverage}");
        assert!(share >= without_lens - 0.05, "view {index}: {share} with the lens, {without_lens} without");
    }
}

#[test]
fn the_unchanged_photographs_are_read_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    write_photographs(folder.path(), &sphere()[..2]);
    write_transforms(folder.path(), &sphere().iter().map(|r| r.view.camera).take(2).collect::<Vec<_>>(), 0.0);
    let scene = surfel_io::Scene::open(folder.path()).unwrap();
    let read = scene.frames[1].pinhole();
    let expected = sphere()[1].view.camera;
    let error = (read.camera_from_world.to_mat4() - expected.camera_from_world.to_mat4()).to_cols_array();
    assert!(error.iter().all(|e| e.abs() < 1e-9) && read.intrinsics == expected.intrinsics);
}
