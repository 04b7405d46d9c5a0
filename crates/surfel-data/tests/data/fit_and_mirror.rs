//! Cropping, scaling and mirroring leave photograph, camera and truth together.

use crate::support::{Plane, assert_photographs, camera, scene};
use glam::DVec3;
use proptest::prelude::*;
use surfel_core::{Camera, Grid};
use surfel_data::fit::{check_field_of_view, cropped, fitted};
use surfel_data::mirror::{mirrored, perhaps_mirrored};
use surfel_data::{DataError, TrainingView};
use surfel_synth::Random;

fn assert_same_sizes(view: &TrainingView) {
    let image = &view.image;
    assert_eq!((view.camera.width, view.camera.height), (image.width(), image.height()));
    assert!(view.depth.as_ref().unwrap().same_size(image));
    assert!(view.normal.as_ref().unwrap().same_size(image));
    assert!(view.mask.as_ref().unwrap().same_size(image));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn a_fitted_view_is_a_photograph_of_the_same_plane(
        (width, height) in (24usize..70, 24usize..70), (wanted_width, wanted_height) in (12usize..40, 12usize..40),
    ) {
        let view = Plane::slanted().photograph("plane", camera(width, height, 1));
        match fitted(&view, wanted_width, wanted_height) {
            Ok(fitted) => {
                assert_same_sizes(&fitted);
                prop_assert_eq!((fitted.image.width(), fitted.image.height()), (wanted_width, wanted_height));
                // The nearest value comes from at most half a stored pixel away, on a plane of slope about 0.4.
                let tolerance = 0.4 * 3.2 / view.camera.intrinsics.fx;
                // A quarter of a pixel where the colours change fastest, and what averaging takes from their waves.
                let pixel = (3.2 / fitted.camera.intrinsics.fx.min(fitted.camera.intrinsics.fy)) as f32;
                let colours = 0.25 * pixel * 1.02 + 0.4 * (2.55 * pixel).powi(2) / 12.0;
                let known = assert_photographs(&fitted, &Plane::slanted(), tolerance, colours);
                prop_assert_eq!(known, wanted_width * wanted_height);
            }
            Err(error) => {
                prop_assert!(wanted_width > width || wanted_height > height);
                let named = error.to_string().contains("view plane has");
                prop_assert!(named, "{}", error);
            }
        }
    }

    #[test]
    fn a_crop_is_exact(x0 in 0usize..20, y0 in 0usize..20) {
        let view = Plane::slanted().photograph("plane", camera(60, 50, 2));
        let cropped = cropped(&view, x0, y0, 40, 30);
        assert_same_sizes(&cropped);
        assert_photographs(&cropped, &Plane::slanted(), 1e-5, 1e-5);
        prop_assert_eq!(cropped.mask.unwrap()[(0, 0)], view.mask.unwrap()[(x0, y0)]);
    }
}

#[test]
fn a_view_of_the_right_size_is_left_alone() {
    let view = Plane::slanted().photograph("plane", camera(32, 24, 0));
    assert_eq!(fitted(&view, 32, 24).unwrap(), view);
}

#[test]
fn what_cannot_be_fitted_is_said() {
    let view = Plane::slanted().photograph("plane 7", camera(32, 24, 0));
    let error = fitted(&view, 33, 24).unwrap_err();
    assert_eq!(error.to_string(), "view plane 7 has 32 x 24 pixels, too few for 33 x 24; ask for a smaller size");
    assert!(fitted(&view, 0, 5).is_err());
}

#[test]
fn wide_angles_are_refused() {
    let mut view = Plane::slanted().photograph("plane 7", camera(32, 24, 0));
    assert!(check_field_of_view(&view).is_ok());
    view.camera.intrinsics.fy = 8.0;
    let error = check_field_of_view(&view).unwrap_err();
    assert!(matches!(error, DataError::TooWide { degrees, .. } if (degrees - 112.6).abs() < 0.1), "{error}");
}

/// The plane in the mirror.
fn mirror_of(plane: Plane) -> Plane {
    Plane { normal: plane.normal * DVec3::new(-1.0, 1.0, 1.0), ..plane }
}

#[test]
fn a_mirrored_view_is_a_photograph_of_the_mirrored_plane() {
    let plane = Plane::slanted();
    let photographs = || (0..3).map(|i| plane.photograph("plane", camera(40, 30, i))).collect::<Vec<_>>();
    let original = scene(photographs(), photographs());
    let mirrored = mirrored(&original);
    for (view, mirror) in original.contexts.iter().zip(&mirrored.contexts) {
        assert_same_sizes(mirror);
        let depth = mirror.depth.as_ref().unwrap();
        for (x, y) in [(0, 0), (7, 11), (39, 29), (20, 3)] {
            let pixel = Camera::pixel_centre(x, y);
            let point = mirror.camera.unproject(pixel, f64::from(depth[(x, y)]));
            assert!(mirror_of(plane).distance(point) < 1e-5);
            let colour = Plane::colour(point * DVec3::new(-1.0, 1.0, 1.0));
            assert!(colour.iter().zip(mirror.image[(x, y)]).all(|(a, b)| (a - b).abs() < 1e-5));
            let normal = DVec3::from(mirror.normal.as_ref().unwrap()[(x, y)].map(f64::from));
            let in_world = mirror.camera.camera_from_world.rotation.transpose() * normal;
            assert!(in_world.cross(mirror_of(plane).normal).length() < 1e-5);
            assert!(normal.dot(mirror.camera.ray(pixel)) < 0.0, "the normal faces away");
            assert_eq!(mirror.mask.as_ref().unwrap()[(x, y)], view.mask.as_ref().unwrap()[(39 - x, y)]);
        }
        assert!(
            (mirror.camera.intrinsics.cx - view.camera.intrinsics.cx).abs() > 1.0,
            "the test needs an off-centre view"
        );
    }
}

#[test]
fn mirroring_twice_is_nothing_and_chance_is_seeded() {
    let view = |i| Plane::slanted().photograph("plane", camera(20, 14, i));
    let original = scene(vec![view(0), view(1)], vec![view(2)]);
    let twice = mirrored(&mirrored(&original));
    for (a, b) in twice.contexts.iter().zip(&original.contexts) {
        assert_eq!((&a.image, &a.depth, &a.normal, &a.mask), (&b.image, &b.depth, &b.normal, &b.mask));
        assert!((a.camera.intrinsics.cx - b.camera.intrinsics.cx).abs() < 1e-12);
        assert_eq!(a.camera.camera_from_world, b.camera.camera_from_world);
    }
    let flips = |seed: u64| -> Vec<bool> {
        let mut random = Random::new(seed);
        (0..100).map(|_| perhaps_mirrored(original.clone(), &mut random) != original).collect()
    };
    let first = flips(1);
    assert_eq!(first, flips(1));
    assert!((30..70).contains(&first.iter().filter(|flip| **flip).count()));
}

#[test]
fn views_without_truth_stay_without() {
    let mut view = Plane::slanted().photograph("plane", camera(40, 30, 0));
    (view.depth, view.normal, view.mask) = (None, None, None);
    let fitted = fitted(&view, 20, 20).unwrap();
    assert_eq!((&fitted.depth, &fitted.normal, &fitted.mask), (&None::<Grid<f32>>, &None, &None));
    assert_eq!(mirrored(&scene(vec![fitted], vec![])).contexts[0].depth, None);
}
