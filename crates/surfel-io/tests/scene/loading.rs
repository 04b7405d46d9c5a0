//! Pixels and cameras stay together through undistortion, resizing, EXIF orientation and masks.
//!
//! The test picture shows its own coordinates, so a loaded pixel tells where it came from.

use crate::written::{self, HEIGHT, WIDTH, coordinates_picture, golden, write, write_images};
use glam::{DVec2, DVec3};
use image::ImageEncoder as _;
use image::metadata::Orientation;
use std::path::{Path, PathBuf};
use surfel_core::{Camera, Intrinsics, Lens, Rigid, lens::Polynomial};
use surfel_io::{Frame, ImageError, Scene};

fn frame(image_path: PathBuf, width: usize, height: usize, lens: Lens) -> Frame {
    let (w, h) = (width as f64, height as f64);
    Frame {
        name: "picture".into(),
        image_path,
        mask_path: None,
        width,
        height,
        intrinsics: Intrinsics { fx: 0.8 * w, fy: 0.82 * w, cx: 0.48 * w, cy: 0.53 * h },
        lens,
        camera_from_world: Rigid::IDENTITY,
        near_far: None,
        orientation: Orientation::NoTransforms,
    }
}

fn lenses() -> [Lens; 5] {
    [
        Lens::None,
        Lens::perspective(Polynomial::opencv(&[-0.2, 0.05, 0.002, -0.003])),
        Lens::perspective(Polynomial::opencv(&[0.15, 0.02, 0.0, 0.001])),
        Lens::Fisheye(Polynomial::radial(&[-0.02, 0.003])),
        Lens::Fov { omega: 0.9 },
    ]
}

#[test]
fn every_pixel_comes_from_where_its_ray_meets_the_sensor() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.png");
    coordinates_picture(320, 240).save(&path).unwrap();
    for lens in lenses() {
        let frame = frame(path.clone(), 320, 240, lens);
        let full = frame.pinhole();
        for (width, height) in [(full.width, full.height), (full.width / 2, full.height / 2), (97, 61)] {
            let view = frame.load(width, height).unwrap();
            let camera = &view.camera;
            assert_eq!(*camera, full.resized(width, height));
            let (mut worst, mut num_valid) = (0.0f64, 0);
            for y in 2..height - 2 {
                for x in 2..width - 2 {
                    let interior = |x: usize, y: usize| view.valid[(x, y)];
                    if !(interior(x, y) && interior(x - 2, y - 2) && interior(x + 2, y + 2)) {
                        continue;
                    }
                    num_valid += 1;
                    let world = camera.unproject(Camera::pixel_centre(x, y), 3.0);
                    let bent = lens.distort(DVec2::new(world.x, world.y) / world.z);
                    let k = frame.intrinsics;
                    let source = DVec2::new(k.fx * bent.x + k.cx, k.fy * bent.y + k.cy);
                    let [red, green, _] = view.image[(x, y)];
                    let error = DVec2::new(f64::from(red) * 320.0 - source.x, f64::from(green) * 240.0 - source.y);
                    // The border of the photograph has no neighbours to blend with.
                    if source.x > 4.0 && source.y > 4.0 && source.x < 316.0 && source.y < 236.0 {
                        worst = worst.max(error.abs().max_element());
                    }
                }
            }
            // 8 bits over 320 pixels are 1.25 pixels a level.
            assert!(worst < 1.3, "{lens:?} at {width}x{height}: off by {worst} pixels");
            assert!(num_valid * 10 > width * height * 5, "{lens:?}: only {num_valid} valid pixels");
        }
    }
}

#[test]
fn the_pinhole_covers_the_photograph_without_much_blank() {
    for lens in lenses()
        .into_iter()
        .chain([Lens::Fisheye(Polynomial::default()), Lens::perspective(Polynomial::radial(&[-0.6]))])
    {
        for focal in [0.25, 0.5, 1.0] {
            let mut frame = frame(PathBuf::new(), 320, 240, lens);
            frame.intrinsics = Intrinsics { fx: focal * 320.0, fy: focal * 320.0, cx: 160.0, cy: 120.0 };
            let camera = frame.pinhole();
            let slope = |pixel: f64, c: f64, f: f64| (pixel - c) / f;
            let k = camera.intrinsics;
            let fov = slope(camera.width as f64, k.cx, k.fx).atan() - slope(0.0, k.cx, k.fx).atan();
            assert!(fov <= 120.2f64.to_radians() || lens.is_none(), "{lens:?} {focal}: {} degrees", fov.to_degrees());
            assert!(camera.width > 60 && camera.height > 60, "{lens:?} {focal}: {camera:?}");
            assert!(camera.contains(DVec2::new(k.cx, k.cy)));
            let centre = camera.ray(DVec2::new(k.cx, k.cy));
            assert!((centre - DVec3::Z).length() < 1e-12);
        }
    }
}

/// A PNG with an EXIF block that holds nothing but the orientation.
fn save_with_orientation(path: &Path, picture: &image::RgbImage, orientation: Orientation) {
    let mut exif = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    exif.extend([orientation.to_exif(), 0, 0, 0, 0, 0, 0, 0]);
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    encoder.set_exif_metadata(exif).unwrap();
    encoder.write_image(picture, picture.width(), picture.height(), image::ExtendedColorType::Rgb8).unwrap();
    std::fs::write(path, bytes).unwrap();
}

/// What a camera stores when the upright picture carries `orientation`.
fn stored(upright: &image::RgbImage, orientation: Orientation) -> image::RgbImage {
    let inverse = match orientation {
        Orientation::Rotate90 => Orientation::Rotate270,
        Orientation::Rotate270 => Orientation::Rotate90,
        other => other,
    };
    let mut picture = image::DynamicImage::ImageRgb8(upright.clone());
    picture.apply_orientation(inverse);
    picture.into_rgb8()
}

#[test]
fn exif_turns_pixels_only_for_cameras_of_the_turned_picture() {
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    for orientation in [Rotate90, Rotate270, Rotate90FlipH, Rotate270FlipH] {
        // Cameras are for 96x64: once that is the upright picture, once the stored one.
        for upright_is_meant in [true, false] {
            let folder = tempfile::tempdir().unwrap();
            let cameras = golden(false);
            write_images(folder.path(), cameras.len());
            written::colmap_text(folder.path(), &cameras);
            let meant = coordinates_picture(WIDTH, HEIGHT);
            let on_disk = if upright_is_meant { stored(&meant, orientation) } else { meant };
            for index in 0..cameras.len() {
                save_with_orientation(&folder.path().join(written::image_name(index)), &on_disk, orientation);
            }
            let scene = Scene::open(folder.path()).unwrap();
            let view = scene.frames[1].load(WIDTH / 2, HEIGHT / 2).unwrap();
            let expected = cameras[1].resized(WIDTH / 2, HEIGHT / 2);
            assert_eq!((view.camera.intrinsics, view.camera.width), (expected.intrinsics, expected.width));
            for (x, y) in [(5, 7), (40, 3), (20, 28)] {
                let [red, green, _] = view.image[(x, y)];
                let source = DVec2::new(f64::from(red) * WIDTH as f64, f64::from(green) * HEIGHT as f64) / 2.0;
                assert!(
                    (source - Camera::pixel_centre(x, y)).length() < 0.4,
                    "{orientation:?} {upright_is_meant}: {source}"
                );
            }
            let said = scene.warnings.join(" ");
            assert!(said.contains(if upright_is_meant { "turned" } else { "ignored" }), "{said}");
        }
    }
}

#[test]
fn masks_come_from_files_or_the_alpha_channel() {
    let folder = tempfile::tempdir().unwrap();
    let left_half = |x: u32| if x < WIDTH as u32 / 2 { 255u8 } else { 0 };
    write_images(folder.path(), 4);
    written::colmap_text(folder.path(), &golden(false));
    let rgba = image::RgbaImage::from_fn(WIDTH as u32, HEIGHT as u32, |x, _| image::Rgba([9, 9, 9, left_half(x)]));
    rgba.save(folder.path().join(written::image_name(0))).unwrap();
    write(folder.path(), "masks/x", "");
    let mask = image::GrayImage::from_fn(WIDTH as u32, HEIGHT as u32, |x, _| image::Luma([left_half(x)]));
    mask.save(folder.path().join("masks/000001.png.png")).unwrap();
    image::GrayImage::new(WIDTH as u32, HEIGHT as u32).save(folder.path().join("masks/2.png")).unwrap();
    let scene = Scene::open(folder.path()).unwrap();
    for index in [0, 1] {
        let view = scene.frames[index].load(48, 32).unwrap();
        for (x, y) in [(0, 0), (23, 31)] {
            assert!(view.valid[(x, y)] && !view.valid[(47 - x, y)], "{index}: {x} {y}");
        }
    }
    let empty = scene.frames[2].load(48, 32).unwrap_err();
    assert!(matches!(empty, ImageError::EmptyMask { .. }) && empty.to_string().contains("masks/2.png"), "{empty}");
    assert!(scene.frames[3].load(48, 32).unwrap().valid.as_slice().iter().all(|valid| *valid));
}

#[test]
fn damaged_and_oversized_photographs_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.jpg");
    image::RgbImage::from_fn(200, 100, |x, y| image::Rgb([(x * y) as u8, x as u8, y as u8])).save(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let png = folder.path().join("picture.png");
    coordinates_picture(200, 100).save(&png).unwrap();
    let png_bytes = std::fs::read(&png).unwrap();
    std::fs::write(&png, &png_bytes[..png_bytes.len() / 2]).unwrap();
    let error = frame(png, 200, 100, Lens::None).load(20, 10).unwrap_err().to_string();
    assert!(error.contains("picture.png") && error.contains("complete"), "{error}");
    // A JPEG cut after its header still decodes in part in some programs; here it must not pass unnoticed.
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let cut = frame(path, 200, 100, Lens::None).load(20, 10);
    assert!(cut.is_err_and(|error| error.to_string().contains("picture.jpg")));
    let wide = folder.path().join("wide.png");
    image::GrayImage::new(20_000, 2).save(&wide).unwrap();
    let error = frame(wide, 20_000, 2, Lens::None).load(20, 10).unwrap_err().to_string();
    assert!(error.contains("wide.png") && error.contains("smaller copy"), "{error}");
}

#[test]
fn sixteen_bits_and_gray_are_read_too() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep.png");
    image::ImageBuffer::from_fn(40, 20, |x, _| image::Luma([x as u16 * 1000])).save(&path).unwrap();
    let view = frame(path, 40, 20, Lens::None).load(40, 20).unwrap();
    let [red, green, blue] = view.image[(30, 10)];
    assert!((red - 30_000.0 / 65_535.0).abs() < 1e-6 && red == green && red == blue);
}
