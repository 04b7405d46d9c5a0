//! LPIPS: with random weights what must hold for any, with the real ones the values of the original.
//!
//! The real weights are looked for at `SURFELSPLAT_LPIPS`, then in the shared data (`SURFELSPLAT_SHARED`, or
//! `../shared` beside the workspace); see `docs/lpips.md` for how to make them.

use crate::known::{picture, value};
use burn::tensor::{Device, Tensor, TensorData};
use rand::{RngExt, SeedableRng, rngs::StdRng};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use surfel_core::Grid;
use surfel_loss::{LossError, Lpips, Perceptual};

/// A file of the right names and shapes: He-sized random convolutions, heads of ones.
fn random_weights() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let mut rng = StdRng::seed_from_u64(1);
        let mut tensors: Vec<(String, Vec<usize>, Vec<f32>)> = Vec::new();
        let mut inputs = 3;
        for (layer, outputs) in [
            (0, 64),
            (2, 64),
            (5, 128),
            (7, 128),
            (10, 256),
            (12, 256),
            (14, 256),
            (17, 512),
            (19, 512),
            (21, 512),
            (24, 512),
            (26, 512),
            (28, 512),
        ] {
            let reach = (6.0 / (9 * inputs) as f32).sqrt();
            let weight = (0..outputs * inputs * 9).map(|_| rng.random_range(-reach..reach)).collect();
            tensors.push((format!("features.{layer}.weight"), vec![outputs, inputs, 3, 3], weight));
            tensors.push((format!("features.{layer}.bias"), vec![outputs], vec![0.01; outputs]));
            inputs = outputs;
        }
        for (stage, channels) in [64, 128, 256, 512, 512].into_iter().enumerate() {
            tensors.push((format!("lin{stage}.weight"), vec![1, channels, 1, 1], vec![1.0; channels]));
        }
        safetensors_of(&tensors)
    })
}

/// The format is a length, a JSON header and the numbers.
fn safetensors_of(tensors: &[(String, Vec<usize>, Vec<f32>)]) -> Vec<u8> {
    let mut start = 0;
    let entries: Vec<String> = tensors
        .iter()
        .map(|(name, shape, values)| {
            let end = start + 4 * values.len();
            let entry =
                format!("\"{name}\":{{\"dtype\":\"F32\",\"shape\":{shape:?},\"data_offsets\":[{start},{end}]}}");
            start = end;
            entry
        })
        .collect();
    let mut header = format!("{{{}}}", entries.join(","));
    header.extend(std::iter::repeat_n(' ', header.len().next_multiple_of(8) - header.len()));
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.as_bytes());
    bytes.extend(tensors.iter().flat_map(|(_, _, values)| values).flat_map(|value| value.to_le_bytes()));
    bytes
}

fn random_lpips(device: &Device) -> Lpips {
    Lpips::from_bytes("random weights", random_weights(), device).expect("a complete file")
}

#[test]
fn equal_pictures_are_equal_and_order_does_not_matter() {
    let lpips = random_lpips(&Device::flex());
    let distance =
        |a: f64, b: f64| value(lpips.distance(picture(20, 17, a), picture(20, 17, b)).expect("large enough"));
    assert_eq!(distance(0.0, 0.0), 0.0);
    assert!(distance(0.0, 0.1) > 1e-4 && distance(0.0, 0.1) < distance(0.0, 0.8));
    assert!((distance(0.0, 0.8) - distance(0.8, 0.0)).abs() < 1e-6);
}

#[test]
fn gradient_equals_finite_differences_and_is_finite_at_equal_pictures() {
    const SIDE: usize = 32;
    let lpips = random_lpips(&Device::flex());
    let gradient = |phase: f64| -> Vec<f32> {
        let start = picture(SIDE, SIDE, phase).autodiff().require_grad();
        let loss = lpips.distance(start.clone(), picture(SIDE, SIDE, 0.8)).expect("large enough");
        start.grad(&loss.backward()).expect("tracked").into_data().try_into_vec().expect("f32")
    };
    assert!(gradient(0.8).iter().all(|g| g.is_finite()));

    let found = gradient(0.0);
    let values: Vec<f32> = picture(SIDE, SIDE, 0.0).into_data().try_into_vec().expect("f32");
    // One direction through all values at once: single ones drown in the rounding of thirteen layers, and a larger
    // step crosses the kinks of the rectifiers.
    let mut rng = StdRng::seed_from_u64(2);
    for _ in 0..3 {
        let direction: Vec<f32> = values.iter().map(|_| rng.random_range(-1.0..1.0)).collect();
        let at = |step: f32| {
            let moved: Vec<f32> = values.iter().zip(&direction).map(|(v, d)| v + step * d).collect();
            let moved = Tensor::from_data(TensorData::new(moved, [3, SIDE, SIDE]), &Device::flex());
            value(lpips.distance(moved, picture(SIDE, SIDE, 0.8)).expect("large enough"))
        };
        let difference = (at(2e-4) - at(-2e-4)) / 4e-4;
        let analytic: f64 = found.iter().zip(&direction).map(|(g, d)| f64::from(g * d)).sum();
        assert!((analytic - difference).abs() < 0.03 * difference.abs().max(0.05), "{analytic} vs {difference}");
    }
}

#[test]
fn a_foreign_file_and_a_small_picture_are_refused() {
    let device = Device::flex();
    let cut = &random_weights()[..1000];
    assert!(Lpips::from_bytes("cut.safetensors", cut, &device).is_err());
    let foreign = safetensors_of(&[("other".to_owned(), vec![1], vec![0.0])]);
    let error = Lpips::from_bytes("foreign.safetensors", &foreign, &device).expect_err("another network");
    assert!(error.to_string().contains("foreign.safetensors"), "{error}");
    let small = random_lpips(&device).distance(picture(15, 20, 0.0), picture(15, 20, 0.0));
    let expected = LossError::TooSmall { measure: "LPIPS", least: 16, width: 15, height: 20 };
    assert_eq!(small.expect_err("15 pixels"), expected);
}

fn shared() -> PathBuf {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    std::env::var_os("SURFELSPLAT_SHARED").map_or(beside, PathBuf::from)
}

fn read(path: &Path) -> Grid<[f32; 3]> {
    let image = image::open(path).expect("a readable picture").to_rgb8();
    Grid::from_fn(image.width() as usize, image.height() as usize, |x, y| {
        image.get_pixel(x as u32, y as u32).0.map(|c| f32::from(c) / 255.0)
    })
}

#[test]
fn reproduces_the_values_of_the_original() {
    let in_shared = shared().join("data/weights/lpips_vgg16_f16.safetensors");
    let weights = std::env::var_os("SURFELSPLAT_LPIPS").map_or(in_shared, PathBuf::from);
    let pictures = shared().join("data/fixtures/lpips");
    if !weights.exists() || !pictures.exists() {
        eprintln!(
            "SKIPPED: needs {} (set SURFELSPLAT_LPIPS) and {} (set SURFELSPLAT_SHARED)",
            weights.display(),
            pictures.display()
        );
        return;
    }
    let lpips = Lpips::from_file(&weights, &Device::flex()).expect("the LPIPS weights");
    for (a, b, expected) in [
        ("apple.png", "pear.png", 0.657_102),
        ("ex_ref.png", "ex_p0.png", 0.568_613),
        ("ex_ref.png", "ex_p1.png", 0.421_664),
    ] {
        let found = lpips.of_pictures(&read(&pictures.join(a)), &read(&pictures.join(b))).expect("equal sizes");
        eprintln!("{a} {b}: {found:.6}, the original says {expected:.6}");
        // Half precision of the stored weights alone moves the value by up to 4e-5.
        assert!((found - expected).abs() < 1e-4, "{a} {b}: {found} instead of {expected}");
    }
    assert_eq!(Perceptual::Lpips(Box::new(lpips)).name(), "LPIPS");
}
