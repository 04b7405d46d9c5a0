//! Maps read back: PFM byte by byte, PNG by the `image` crate, cameras as JSON.

use glam::{DQuat, DVec3};
use surfel_core::{Camera, Grid, Intrinsics, Rigid};
use surfel_io::write::cameras_json::{CameraRecord, write_cameras_json};
use surfel_io::write::confidence_png::write_confidence_png;
use surfel_io::write::depth_png::{depth_png_unit, write_depth_png, write_depth_sidecar};
use surfel_io::write::normal_png::write_normal_png;
use surfel_io::write::pfm::{write_pfm, write_pfm_rgb};
use surfel_io::write::picture_png::write_gray_png;

fn depth() -> Grid<f32> {
    Grid::from_fn(5, 4, |x, y| if x == y { 0.0 } else { 2.0 + x as f32 + 0.37 * y as f32 })
}

fn written(write: impl FnOnce(&mut Vec<u8>) -> std::io::Result<()>) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(&mut bytes).unwrap();
    bytes
}

#[test]
fn pfm_is_bottom_up_little_endian() {
    let depth = depth();
    let bytes = written(|out| write_pfm(out, &depth));
    let body = bytes.strip_prefix(b"Pf\n5 4\n-1.0\n").unwrap();
    let values: Vec<f32> = body.chunks(4).map(|value| f32::from_le_bytes(value.try_into().unwrap())).collect();
    let back = Grid::from_fn(5, 4, |x, y| values[(3 - y) * 5 + x]);
    assert_eq!(back, depth);
}

#[test]
fn three_channels_and_bytes_come_back_as_they_were() {
    let normals = Grid::from_fn(3, 2, |x, y| [x as f32, -(y as f32), 0.25]);
    let bytes = written(|out| write_pfm_rgb(out, &normals));
    let body = bytes.strip_prefix(b"PF\n3 2\n-1.0\n").unwrap();
    let values: Vec<f32> = body.chunks(4).map(|value| f32::from_le_bytes(value.try_into().unwrap())).collect();
    let at = |x: usize, y: usize, i: usize| values[((1 - y) * 3 + x) * 3 + i];
    assert_eq!(Grid::from_fn(3, 2, |x, y| [0, 1, 2].map(|i| at(x, y, i))), normals);
    let labels = Grid::from_fn(4, 3, |x, y| (x * 70 + y) as u8);
    let picture = image::load_from_memory(&written(|out| write_gray_png(out, &labels))).unwrap();
    assert_eq!(picture.into_luma8().into_raw(), labels.as_slice());
}

#[test]
fn depth_png_is_count_times_unit() {
    let depth = depth();
    let unit = depth_png_unit(7.2);
    let bytes = written(|out| write_depth_png(out, &depth, unit));
    let picture = image::load_from_memory(&bytes).unwrap().into_luma16();
    for (pixel, z) in picture.pixels().zip(depth.as_slice()) {
        assert!((f64::from(pixel.0[0]) * unit - f64::from(*z)).abs() <= unit / 2.0);
    }
    let reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
    let texts = &reader.info().uncompressed_latin1_text;
    assert!(texts.iter().any(|text| text.keyword == "DepthUnit" && text.text.parse::<f64>().unwrap() == unit));
    let sidecar = written(|out| write_depth_sidecar(out, &depth, unit));
    let sidecar: serde_json::Value = serde_json::from_slice(&sidecar).unwrap();
    assert_eq!((sidecar["unit_per_count"].as_f64(), sidecar["none"].as_u64()), (Some(unit), Some(0)));
}

#[test]
fn depth_png_keeps_none_apart_from_near_and_far() {
    let depth = Grid::from_vec(5, 1, vec![0.0, 1e-9, f32::NAN, 1e9, f32::INFINITY]);
    let bytes = written(|out| write_depth_png(out, &depth, 0.01));
    assert_eq!(image::load_from_memory(&bytes).unwrap().into_luma16().into_raw(), [0, 1, 0, 65535, 0]);
}

#[test]
fn normals_decode_to_themselves_and_none_is_black() {
    let normal = [0.48, -0.6, -0.64];
    let grid = Grid::from_vec(3, 1, vec![normal, [0.0; 3], [f32::NAN; 3]]);
    let picture = image::load_from_memory(&written(|out| write_normal_png(out, &grid))).unwrap().into_rgb8();
    let back = picture.get_pixel(0, 0).0.map(|byte| f32::from(byte) / 255.0 * 2.0 - 1.0);
    assert!(back.iter().zip(normal).all(|(b, n)| (b - n).abs() < 1.0 / 255.0 + 1e-6));
    assert_eq!((picture.get_pixel(1, 0).0, picture.get_pixel(2, 0).0), ([0; 3], [0; 3]));
}

#[test]
fn confidence_is_clamped() {
    let grid = Grid::from_vec(5, 1, vec![0.0, 0.5, 1.0, 7.0, f32::NAN]);
    let bytes = written(|out| write_confidence_png(out, &grid));
    assert_eq!(image::load_from_memory(&bytes).unwrap().into_luma8().into_raw(), [0, 128, 255, 255, 0]);
}

#[test]
fn a_map_without_pixels_is_refused_with_a_sentence() {
    let error = write_depth_png(&mut Vec::new(), &Grid::filled(0, 3, 1.0), 1.0).unwrap_err();
    assert_eq!(error.to_string(), "a PNG cannot be 0x3 pixels");
}

#[test]
fn cameras_round_trip_exactly() {
    let camera = Camera {
        intrinsics: Intrinsics { fx: 1234.567890123, fy: 1200.1, cx: 319.7, cy: 0.1 + 0.2 },
        width: 640,
        height: 480,
        camera_from_world: Rigid::from_quat(DQuat::from_rotation_y(0.4), DVec3::new(1e6 / 3.0, -2.0, 0.1)),
    };
    let records = [
        CameraRecord { image: "images/a.png", camera: &camera, near_far: Some((0.5, 9.0)) },
        CameraRecord { image: "b.jpg", camera: &camera, near_far: None },
    ];
    // The reader must ask serde_json for exact floats; here the text itself is compared.
    let text = String::from_utf8(written(|out| write_cameras_json(out, &records))).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let first = &json[0];
    assert_eq!((first["image"].as_str(), first["width"].as_u64()), (Some("images/a.png"), Some(640)));
    assert_eq!((first["near"].as_f64(), json[1].get("near")), (Some(0.5), None));
    let numbers = |key: &str| -> Vec<f64> {
        let start = text.find(&format!("\"{key}\": [")).unwrap() + key.len() + 5;
        let list = &text[start..start + text[start..].find(']').unwrap()];
        list.split(',').map(|number| number.trim().parse().unwrap()).collect()
    };
    assert_eq!(numbers("K"), [1234.567890123, 0.0, 319.7, 0.0, 1200.1, 0.1 + 0.2, 0.0, 0.0, 1.0]);
    let pose = numbers("camera_from_world");
    let rotation = camera.camera_from_world.rotation;
    assert_eq!((pose[2], pose[3], pose[8]), (rotation.z_axis.x, 1e6 / 3.0, rotation.x_axis.z));
    assert_eq!(pose[12..], [0.0, 0.0, 0.0, 1.0]);
}
