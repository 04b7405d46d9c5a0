//! Sparse matches against exact truth: a match is right when the surface really projects to both pixels.

use glam::{DMat3, DVec2, DVec3};
use std::sync::OnceLock;
use surfel_core::{Camera, Grid, Intrinsics, Rigid, View};
use surfel_pair::{Features, Match, match_views};
use surfel_synth::{RenderedView, SceneKind, SceneOptions};

fn rendered(pair_angle_deg: f64) -> (RenderedView, RenderedView) {
    let options = SceneOptions {
        kind: SceneKind::HeightField,
        width: 320,
        height: 240,
        supersampling: 2,
        noise: 0.01,
        pair_angle_deg,
        ..SceneOptions::default()
    };
    let mut views = options.render().into_iter();
    (views.next().expect("two views"), views.next().expect("two views"))
}

/// Distance of every match from the true partner of its first pixel, pixels.
fn errors(a: &RenderedView, b: &Camera, matches: &[Match]) -> Vec<f64> {
    let partner = |pixel: DVec2| {
        let depth = f64::from(a.depth.bilinear(pixel.x - 0.5, pixel.y - 0.5)?);
        b.project(a.view.camera.unproject(pixel, depth)).map(|(partner, _)| partner)
    };
    matches.iter().filter_map(|m| Some((partner(m.a)? - m.b).length())).collect()
}

fn assert_right(errors: &[f64], min_count: usize, what: &str) {
    let num_right = errors.iter().filter(|error| **error < 1.5).count();
    assert!(num_right >= min_count, "{what}: {num_right} right matches of {}", errors.len());
    assert!(10 * num_right >= 9 * errors.len(), "{what}: {num_right} right matches of {}", errors.len());
}

/// Rendering is the slow part, so the tests share one near pair.
fn near_pair() -> &'static (RenderedView, RenderedView) {
    static PAIR: OnceLock<(RenderedView, RenderedView)> = OnceLock::new();
    PAIR.get_or_init(|| rendered(8.0))
}

#[test]
fn matches_hit_the_true_partner_up_to_30_degrees() {
    let far_pair = rendered(30.0);
    for (pair, min_count, what) in [(near_pair(), 200, "8 degrees"), (&far_pair, 40, "30 degrees")] {
        let (a, b) = pair;
        assert_right(&errors(a, &b.view.camera, &match_views(&a.view, &b.view)), min_count, what);
    }
}

#[test]
fn a_quarter_turn_costs_few_matches() {
    let (a, b) = near_pair();
    let height = b.view.image.height();
    let image = Grid::from_fn(height, b.view.image.width(), |x, y| b.view.image[(y, height - 1 - x)]);
    let k = b.view.camera.intrinsics;
    let turn = DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z);
    let camera = Camera {
        intrinsics: Intrinsics { fx: k.fy, fy: k.fx, cx: height as f64 - k.cy, cy: k.cx },
        width: height,
        height: b.view.image.width(),
        camera_from_world: Rigid { rotation: turn, translation: DVec3::ZERO } * b.view.camera.camera_from_world,
    };
    let upright = match_views(&a.view, &b.view);
    let turned = match_views(&a.view, &View::new("turned", image, camera));
    assert_right(&errors(a, &camera, &turned), upright.len() * 8 / 10, "quarter turn");
}

#[test]
fn masked_pixels_and_their_border_hold_no_keypoint() {
    let mut view = near_pair().0.view.clone();
    for y in 0..view.image.height() {
        for x in 0..160 {
            view.valid[(x, y)] = false;
            view.image[(x, y)] = [0.0; 3];
        }
    }
    let features = Features::of(&view);
    assert!(!features.is_empty());
    for keypoint in features.keypoints() {
        assert!(keypoint.position.x - 2.0 * keypoint.sigma >= 160.0, "{keypoint:?}");
    }
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let (a, b) = near_pair();
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| match_views(&a.view, &b.view))
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn tiny_and_plain_images_match_nothing() {
    for (width, height) in [(1, 1), (3, 40), (64, 48)] {
        let camera = Camera {
            intrinsics: Intrinsics { fx: 50.0, fy: 50.0, cx: 0.5 * width as f64, cy: 0.5 * height as f64 },
            width,
            height,
            camera_from_world: Rigid::IDENTITY,
        };
        for value in [0.5, f32::NAN, f32::INFINITY] {
            let view = View::new("plain", Grid::filled(width, height, [value; 3]), camera);
            assert_eq!(match_views(&view, &view), [], "{width} x {height} of {value}");
        }
    }
}
