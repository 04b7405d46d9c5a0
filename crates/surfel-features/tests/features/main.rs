//! The feature extractor against plain loops, its geometry, and what it says about damaged weights.

mod trunk_twin;

use surfel_core::Grid;
use surfel_features::{FeatureExtractor, Stage, WeightsError};

const WEIGHTS: &[u8] = include_bytes!("../../weights/efficientnet_lite0_trunk_s16_f16.safetensors");
const ALL: [Stage; 3] = [Stage::S4, Stage::S8, Stage::S16];

/// A deterministic image with structure at every scale.
fn picture(width: usize, height: usize) -> Grid<[f32; 3]> {
    let mut state = 12345u32;
    Grid::from_fn(width, height, |x, y| {
        std::array::from_fn(|c| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = (state >> 8) as f32 / (1 << 24) as f32;
            let wave = (0.31 * x as f32 + 0.17 * (y * (c + 1)) as f32).sin();
            (0.5 + 0.3 * wave + 0.4 * (noise - 0.5)).clamp(0.0, 1.0)
        })
    })
}

#[test]
fn equals_the_plain_loops_at_odd_sizes() {
    let extractor = FeatureExtractor::new().unwrap();
    for (width, height) in [(35, 29), (48, 16), (1, 7)] {
        let image = picture(width, height);
        let twin = trunk_twin::run(WEIGHTS, &image);
        for (map, stage) in extractor.extract(&image, &ALL).iter().zip(ALL) {
            assert_eq!((map.width, map.height), (width.div_ceil(map.stride), height.div_ceil(map.stride)));
            assert_eq!((map.channels, map.stride), (stage.channels(), stage.stride()));
            let expected = &twin[&stage.stride()];
            for y in 0..map.height {
                for x in 0..map.width {
                    for (c, value) in map.pixel(x, y).iter().enumerate() {
                        let reference = expected.at(c, y, x);
                        let error = (f64::from(*value) - reference).abs();
                        assert!(
                            error < 1e-4,
                            "{stage:?} {width}x{height} ({x},{y}) channel {c}: {value} vs {reference}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn stages_do_not_depend_on_each_other_nor_on_the_number_of_threads() {
    let extractor = FeatureExtractor::new().unwrap();
    let image = picture(70, 45);
    let all = extractor.extract(&image, &ALL);
    for (map, stage) in all.iter().zip(ALL) {
        assert_eq!(extractor.extract(&image, &[stage])[0], *map);
    }
    assert_eq!(extractor.extract(&image, &[Stage::S8, Stage::S8]), vec![all[1].clone(); 2]);
    let three = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    assert_eq!(three.install(|| extractor.extract(&image, &ALL)), all);
}

#[test]
fn a_feature_is_centred_where_the_documentation_says() {
    let extractor = FeatureExtractor::new().unwrap();
    let image = picture(96, 96);
    let before = &extractor.extract(&image, &[Stage::S4])[0];
    let (column, row) = (11, 9);
    let reached: Vec<usize> = (0..96)
        .filter(|&x| {
            let mut changed = image.clone();
            for y in 0..96 {
                changed[(x, y)] = changed[(x, y)].map(|v| 1.0 - v);
            }
            extractor.extract(&changed, &[Stage::S4])[0].pixel(column, row) != before.pixel(column, row)
        })
        .collect();
    let (first, last) = (reached[0] as f64, *reached.last().unwrap() as f64);
    // Index coordinates of both ends, so the middle in continuous coordinates is half a pixel further.
    assert_eq!((first + last) / 2.0 + 0.5, before.centre_in_input(column));
    assert_eq!(before.centre_in_input(column), 4.0 * 11.0 + 3.5);
    assert_eq!(before.index_from_input(before.centre_in_input(column)), 11.0);
}

#[test]
fn an_image_without_pixels_or_with_poison_does_not_panic() {
    let extractor = FeatureExtractor::new().unwrap();
    let empty = extractor.extract(&Grid::from_vec(0, 0, Vec::new()), &ALL);
    assert!(empty.len() == 3 && empty.iter().all(|m| m.data.is_empty() && m.width == 0));
    extractor.extract(&Grid::filled(20, 20, [f32::NAN, f32::INFINITY, -1e30]), &ALL);
    assert!(extractor.extract(&picture(9, 9), &[]).is_empty());
}

#[test]
fn damaged_weights_are_explained() {
    let folder = tempfile::tempdir().unwrap();
    let load = |bytes: &[u8]| {
        let path = folder.path().join("w.safetensors");
        std::fs::write(&path, bytes).unwrap();
        FeatureExtractor::from_file(&path)
    };
    assert!(load(WEIGHTS).is_ok());
    for bytes in [&WEIGHTS[..0], &WEIGHTS[..7], &WEIGHTS[..900], &WEIGHTS[..WEIGHTS.len() - 1], &[0xff; 64]] {
        let error = load(bytes).unwrap_err();
        assert!(matches!(error, WeightsError::Malformed { .. }), "{error}");
        assert!(error.to_string().contains("w.safetensors"));
    }
    let edited = |from: &str, to: &str| {
        let at = WEIGHTS.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        let mut bytes = WEIGHTS.to_vec();
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        load(&bytes).unwrap_err()
    };
    let error = edited("_conv_stem.weight", "_conv_root.weight");
    assert!(matches!(&error, WeightsError::Missing { tensor, .. } if tensor == "_conv_stem.weight"), "{error}");
    let error = edited("\"shape\":[32,1,3,3]", "\"shape\":[1,32,3,3]");
    assert!(matches!(&error, WeightsError::WrongShape { .. }), "{error}");
    let mut bytes = WEIGHTS.to_vec();
    let last = bytes.len() - 2;
    bytes[last..].copy_from_slice(&half::f16::NAN.to_le_bytes());
    let error = load(&bytes).unwrap_err();
    assert!(matches!(&error, WeightsError::NotFinite { .. }), "{error}");
    let error = FeatureExtractor::from_file(folder.path().join("absent")).unwrap_err();
    assert!(matches!(&error, WeightsError::Unreadable { .. }), "{error}");
}
