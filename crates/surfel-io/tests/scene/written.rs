//! Writers of every camera format, for tests: one set of cameras in, a scene folder out.
//!
//! Written from the formats' descriptions and not from the readers, so that both must be right.

use glam::{DMat3, DMat4, DQuat, DVec3};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use surfel_core::{Camera, Intrinsics, Rigid};

pub const WIDTH: usize = 96;
pub const HEIGHT: usize = 64;

/// Four cameras in general position; `centred` ones have one focal length and the principal point in the
/// middle, which is all that some formats can say.
pub fn golden(centred: bool) -> Vec<Camera> {
    let general = Intrinsics { fx: 120.0, fy: 118.5, cx: 46.75, cy: 33.25 };
    let middle = Intrinsics { fx: 120.0, fy: 120.0, cx: 48.0, cy: 32.0 };
    let camera = |i: usize| {
        let angle = i as f64;
        let rotation = DQuat::from_euler(glam::EulerRot::YXZ, 0.3 * angle - 0.4, 0.1 * angle, 0.05 - 0.2 * angle);
        Camera {
            intrinsics: if centred { middle } else { general },
            width: WIDTH,
            height: HEIGHT,
            camera_from_world: Rigid::from_quat(rotation, DVec3::new(0.3 * angle, -0.2, 4.0 + 0.5 * angle)),
        }
    };
    (0..4).map(camera).collect()
}

/// `images/000000.png`, ...
pub fn image_name(index: usize) -> String {
    format!("images/{index:06}.png")
}

pub fn write(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

/// A picture that shows its own coordinates: red is x / width, green is y / height.
pub fn coordinates_picture(width: usize, height: usize) -> image::RgbImage {
    let level = |at: u32, length: usize| ((f64::from(at) + 0.5) / length as f64 * 255.0).round() as u8;
    image::RgbImage::from_fn(width as u32, height as u32, |x, y| image::Rgb([level(x, width), level(y, height), 128]))
}

pub fn write_images(folder: &Path, count: usize) {
    std::fs::create_dir_all(folder.join("images")).unwrap();
    for index in 0..count {
        coordinates_picture(WIDTH, HEIGHT).save(folder.join(image_name(index))).unwrap();
    }
}

fn rows3(m: DMat3) -> [f64; 9] {
    m.transpose().to_cols_array()
}

fn rows4(m: DMat4) -> [f64; 16] {
    m.transpose().to_cols_array()
}

fn spaced(numbers: &[f64]) -> String {
    numbers.iter().map(|n| format!("{n}")).collect::<Vec<_>>().join(" ")
}

/// Row-major K with the first pixel centre at 0.
fn index_k(k: &Intrinsics) -> [f64; 9] {
    [k.fx, 0.0, k.cx - 0.5, 0.0, k.fy, k.cy - 0.5, 0.0, 0.0, 1.0]
}

fn world_from_camera(camera: &Camera) -> Rigid {
    camera.camera_from_world.inverse()
}

fn opengl(camera: &Camera) -> String {
    let flip = DMat4::from_diagonal(glam::DVec4::new(1.0, -1.0, -1.0, 1.0));
    let rows = rows4(world_from_camera(camera).to_mat4() * flip);
    let rows: Vec<String> = rows.chunks(4).map(|row| format!("{row:?}")).collect();
    format!("[{}]", rows.join(","))
}

pub fn colmap_text(folder: &Path, cameras: &[Camera]) {
    let k = cameras[0].intrinsics;
    write(
        folder,
        "sparse/0/cameras.txt",
        format!("# cameras\n7 PINHOLE {WIDTH} {HEIGHT} {} {} {} {}\n", k.fx, k.fy, k.cx, k.cy),
    );
    let mut images = String::from("# images\n");
    // Listed backwards: order in the file is not order of the names.
    for (index, camera) in cameras.iter().enumerate().rev() {
        let q = DQuat::from_mat3(&camera.camera_from_world.rotation);
        let t = camera.camera_from_world.translation;
        let pose = spaced(&[q.w, q.x, q.y, q.z, t.x, t.y, t.z]);
        writeln!(images, "{} {pose} 7 {:06}.png\n10.5 11.5 -1 3 4 2", 100 - index, index).unwrap();
    }
    write(folder, "sparse/0/images.txt", images);
    write(folder, "sparse/0/points3D.txt", "2 0.5 -0.25 1 255 0 0 0.1 100 1 98 0\n");
}

pub fn colmap_binary(folder: &Path, cameras: &[Camera]) {
    let k = cameras[0].intrinsics;
    let mut bytes = Vec::new();
    bytes.extend(1u64.to_le_bytes());
    bytes.extend(7u32.to_le_bytes());
    bytes.extend(1i32.to_le_bytes());
    [WIDTH as u64, HEIGHT as u64].iter().for_each(|n| bytes.extend(n.to_le_bytes()));
    [k.fx, k.fy, k.cx, k.cy].iter().for_each(|n| bytes.extend(n.to_le_bytes()));
    write(folder, "sparse/0/cameras.bin", bytes);
    let mut bytes = (cameras.len() as u64).to_le_bytes().to_vec();
    for (index, camera) in cameras.iter().enumerate().rev() {
        let q = DQuat::from_mat3(&camera.camera_from_world.rotation);
        let t = camera.camera_from_world.translation;
        bytes.extend((100 - index as u32).to_le_bytes());
        [q.w, q.x, q.y, q.z, t.x, t.y, t.z].iter().for_each(|n| bytes.extend(n.to_le_bytes()));
        bytes.extend(7u32.to_le_bytes());
        bytes.extend(format!("{index:06}.png\0").bytes());
        bytes.extend(1u64.to_le_bytes());
        [10.5f64, 11.5].iter().for_each(|n| bytes.extend(n.to_le_bytes()));
        bytes.extend((-1i64).to_le_bytes());
    }
    write(folder, "sparse/0/images.bin", bytes);
    let mut bytes = 1u64.to_le_bytes().to_vec();
    bytes.extend(2u64.to_le_bytes());
    [0.5f64, -0.25, 1.0].iter().for_each(|n| bytes.extend(n.to_le_bytes()));
    bytes.extend([255, 0, 0]);
    bytes.extend(0.1f64.to_le_bytes());
    bytes.extend(2u64.to_le_bytes());
    [100u32, 1, 98, 0].iter().for_each(|n| bytes.extend(n.to_le_bytes()));
    write(folder, "sparse/0/points3D.bin", bytes);
}

pub fn transforms(folder: &Path, cameras: &[Camera]) {
    let k = cameras[0].intrinsics;
    let frame = |(index, camera): (usize, &Camera)| {
        format!(r#"{{"file_path": "./{}", "transform_matrix": {}}}"#, image_name(index), opengl(camera))
    };
    let frames: Vec<String> = cameras.iter().enumerate().map(frame).collect();
    let optics = format!(
        r#""camera_model": "OPENCV", "fl_x": {}, "fl_y": {}, "cx": {}, "cy": {}, "w": {WIDTH}.0, "h": {HEIGHT}"#,
        k.fx, k.fy, k.cx, k.cy
    );
    write(folder, "transforms.json", format!(r#"{{{optics}, "frames": [{}]}}"#, frames.join(",")));
}

pub fn transforms_per_frame(folder: &Path, cameras: &[Camera]) {
    let frame = |(index, camera): (usize, &Camera)| {
        let (name, pose, k) = (image_name(index), opengl(camera), camera.intrinsics);
        format!(
            r#"{{"file_path": "{name}", "transform_matrix": {pose}, "fl_x": {}, "fl_y": {}, "cx": {}, "cy": {}, "w": {WIDTH}, "h": {HEIGHT}}}"#,
            k.fx, k.fy, k.cx, k.cy
        )
    };
    let frames: Vec<String> = cameras.iter().enumerate().map(frame).collect();
    write(folder, "transforms.json", format!(r#"{{"frames": [{}]}}"#, frames.join(",")));
}

pub fn blender(folder: &Path, cameras: &[Camera]) {
    let frame = |(index, camera): (usize, &Camera)| {
        let name = image_name(index);
        format!(
            r#"{{"file_path": "./{}", "rotation": 0.1, "transform_matrix": {}}}"#,
            name.trim_end_matches(".png"),
            opengl(camera)
        )
    };
    let frames: Vec<String> = cameras.iter().enumerate().map(frame).collect();
    let angle = 2.0 * (0.5 * WIDTH as f64 / cameras[0].intrinsics.fx).atan();
    write(
        folder,
        "transforms_train.json",
        format!(r#"{{"camera_angle_x": {angle}, "frames": [{}]}}"#, frames.join(",")),
    );
}

pub fn npy(shape: &[usize], data: &[f64]) -> Vec<u8> {
    let shape: String = shape.iter().map(|length| format!("{length}, ")).collect();
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({shape}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    data.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
    bytes
}

pub fn npz(arrays: &[(String, Vec<usize>, Vec<f64>)]) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, shape, data) in arrays {
        archive.start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default()).unwrap();
        archive.write_all(&npy(shape, data)).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

pub fn idr(folder: &Path, cameras: &[Camera]) {
    let mut arrays = Vec::new();
    for (index, camera) in cameras.iter().enumerate() {
        let k = DMat4::from_mat3(DMat3::from_cols_array(&index_k(&camera.intrinsics)).transpose());
        // A projection matrix means the same at any scale and sign.
        let scale = [1.0, -2.0, 0.5, -1.0][index % 4];
        let world_mat = k * camera.camera_from_world.to_mat4() * scale;
        arrays.push((format!("world_mat_{index}"), vec![4, 4], rows4(world_mat).to_vec()));
        let sphere =
            DMat4::from_scale_rotation_translation(DVec3::splat(1.5), DQuat::IDENTITY, DVec3::new(0.1, 0.0, 0.2));
        arrays.push((format!("scale_mat_{index}"), vec![4, 4], rows4(sphere).to_vec()));
    }
    write(folder, "cameras_sphere.npz", npz(&arrays));
}

pub fn robustmvd(folder: &Path, cameras: &[Camera]) {
    let k = cameras.iter().flat_map(|camera| index_k(&camera.intrinsics)).collect();
    let poses = cameras.iter().flat_map(|camera| rows4(camera.camera_from_world.to_mat4())).collect();
    let n = cameras.len();
    let arrays = [("K".to_owned(), vec![n, 3, 3], k), ("to_ref_transform".to_owned(), vec![n, 4, 4], poses)];
    write(folder, "cameras.npz", npz(&arrays));
}

pub fn mvsnet(folder: &Path, cameras: &[Camera]) {
    for (index, camera) in cameras.iter().enumerate() {
        let mut text = String::from("extrinsic\n");
        rows4(camera.camera_from_world.to_mat4()).chunks(4).for_each(|row| writeln!(text, "{} ", spaced(row)).unwrap());
        text.push_str("\nintrinsic\n");
        index_k(&camera.intrinsics).chunks(3).for_each(|row| writeln!(text, "{}", spaced(row)).unwrap());
        text.push_str("\n2.5 0.5 \n");
        write(folder, &format!("cams/{index:08}_cam.txt"), text);
    }
    write(folder, "pair.txt", "1\n0\n1 1 100.0\n");
}

pub fn llff(folder: &Path, cameras: &[Camera]) {
    let row = |camera: &Camera| {
        let pose = world_from_camera(camera);
        let [right, down, forward] = [pose.rotation.x_axis, pose.rotation.y_axis, pose.rotation.z_axis];
        let size = DVec3::new(HEIGHT as f64, WIDTH as f64, camera.intrinsics.fx);
        let columns = [down, right, -forward, pose.translation, size];
        let matrix = (0..3).flat_map(|row| columns.map(|column| column[row]));
        matrix.chain([2.0, 9.0]).collect::<Vec<_>>()
    };
    write(folder, "poses_bounds.npy", npy(&[cameras.len(), 17], &cameras.iter().flat_map(row).collect::<Vec<_>>()));
}

pub fn re10k(folder: &Path, cameras: &[Camera]) {
    let mut text = String::from("https://www.youtube.com/watch?v=x\n");
    let (w, h) = (WIDTH as f64, HEIGHT as f64);
    for (index, camera) in cameras.iter().enumerate() {
        let k = camera.intrinsics;
        let pose = &rows4(camera.camera_from_world.to_mat4())[..12];
        let optics = spaced(&[k.fx / w, k.fy / h, k.cx / w, k.cy / h, 0.0, 0.0]);
        writeln!(text, "{} {optics} {}", 1_000_000 + 33_000 * index, spaced(pose)).unwrap();
    }
    write(folder, "clip.txt", text);
}

pub fn cameras_json(folder: &Path, cameras: &[Camera]) {
    let frame = |(index, camera): (usize, &Camera)| {
        let (k, name) = (camera.intrinsics, image_name(index));
        let k = [k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0];
        let pose = rows4(camera.camera_from_world.to_mat4());
        format!(
            r#"{{"image": "{name}", "width": {WIDTH}, "height": {HEIGHT}, "K": {k:?}, "camera_from_world": {pose:?}, "near": 2, "far": 9}}"#
        )
    };
    let frames: Vec<String> = cameras.iter().enumerate().map(frame).collect();
    write(folder, "cameras.json", format!("[{}]", frames.join(",\n")));
}

pub fn cameras_json_with_centres(folder: &Path, cameras: &[Camera]) {
    let frame = |(index, camera): (usize, &Camera)| {
        let rows: Vec<String> =
            rows3(camera.camera_from_world.rotation).chunks(3).map(|row| format!("{row:?}")).collect();
        let centre = camera.centre().to_array();
        format!(r#"{{"image": "{}", "R": [{}], "C": {centre:?}}}"#, image_name(index), rows.join(","))
    };
    let frames: Vec<String> = cameras.iter().enumerate().map(frame).collect();
    let k = index_k(&cameras[0].intrinsics);
    let convention = "x_cam = R (X - C); pixel centres at integer coordinates";
    let head = format!(r#""convention": "{convention}", "width": {WIDTH}, "height": {HEIGHT}, "K": {k:?}"#);
    write(folder, "cameras.json", format!(r#"{{{head}, "frames": [{}]}}"#, frames.join(",\n")));
}

pub fn middlebury(folder: &Path, cameras: &[Camera]) {
    let mut text = format!("{}\n", cameras.len());
    for (index, camera) in cameras.iter().enumerate() {
        let pose = &camera.camera_from_world;
        let numbers =
            [spaced(&index_k(&camera.intrinsics)), spaced(&rows3(pose.rotation)), spaced(&pose.translation.to_array())];
        writeln!(text, "{index:06}.png {}", numbers.join(" ")).unwrap();
    }
    write(folder, "golden_par.txt", text);
}

/// For images of twice the size, as the published sets often are.
pub fn strecha(folder: &Path, cameras: &[Camera]) {
    for (index, camera) in cameras.iter().enumerate() {
        let k = camera.resized(2 * WIDTH, 2 * HEIGHT).intrinsics;
        let pose = world_from_camera(camera);
        let numbers =
            [spaced(&index_k(&k)), "0 0 0".into(), spaced(&rows3(pose.rotation)), spaced(&pose.translation.to_array())];
        write(
            folder,
            &format!("cameras/{index:06}.png.camera"),
            format!("{}\n{} {}\n", numbers.join("\n"), 2 * WIDTH, 2 * HEIGHT),
        );
    }
}

pub fn poses_text(folder: &Path, cameras: &[Camera]) {
    let lines: Vec<String> = cameras.iter().map(|camera| spaced(&rows4(world_from_camera(camera).to_mat4()))).collect();
    write(folder, "poses.txt", lines.join("\n"));
    write(folder, "K.txt", spaced(&index_k(&cameras[0].intrinsics)));
    let names: Vec<String> = (0..cameras.len()).map(|index| format!("{index:06}")).collect();
    write(folder, "frames.txt", names.join("\n"));
}

pub fn trajectory_log(folder: &Path, cameras: &[Camera]) {
    let mut text = String::new();
    for (index, camera) in cameras.iter().enumerate() {
        writeln!(text, "{index} {index} {}", index + 1).unwrap();
        rows4(world_from_camera(camera).to_mat4()).chunks(4).for_each(|row| writeln!(text, "{}", spaced(row)).unwrap());
    }
    write(folder, "trajectory.log", text);
    let k = index_k(&cameras[0].intrinsics);
    let column_major = [k[0], 0.0, 0.0, 0.0, k[4], 0.0, k[2], k[5], 1.0];
    write(
        folder,
        "intrinsic.json",
        format!(r#"{{"width": {WIDTH}, "height": {HEIGHT}, "intrinsic_matrix": {column_major:?}}}"#),
    );
}
