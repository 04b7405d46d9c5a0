//! "Tell me my cameras are wrong before showing me mush": every classic mistake, put into a good scene,
//! is named by the verdict, and good scenes of every kind raise no alarm.

use glam::{DMat3, DVec3};
use proptest::prelude::*;
use std::sync::OnceLock;
use surfel_core::{Camera, Grid, Intrinsics, Rigid, View};
use surfel_pair::{IntrinsicsMistake, Match, Mistake, PoseMistake, Status, check_pair, match_views};
use surfel_synth::{RenderOptions, SceneKind, SceneOptions, Texture, WalkRig};

/// Two photographs of the rolling height field and their matches.
fn good_pair() -> &'static (View, View, Vec<Match>) {
    static PAIR: OnceLock<(View, View, Vec<Match>)> = OnceLock::new();
    PAIR.get_or_init(|| {
        let (mut a, mut b) = pair_of(&options());
        // Cameras on a circle about the origin make several mistakes look alike; nobody's origin is there by chance.
        let old_from_new = surfel_synth::look_at(DVec3::new(310.0, -170.0, 120.0), DVec3::new(-40.0, 90.0, 60.0));
        for view in [&mut a, &mut b] {
            view.camera.camera_from_world = view.camera.camera_from_world * old_from_new;
        }
        matched((a, b))
    })
}

fn options() -> SceneOptions {
    SceneOptions { kind: SceneKind::HeightField, width: 320, height: 240, supersampling: 2, ..SceneOptions::default() }
}

fn pair_of(options: &SceneOptions) -> (View, View) {
    let mut views = options.render().into_iter().map(|rendered| rendered.view);
    (views.next().expect("two views"), views.next().expect("two views"))
}

fn matched((a, b): (View, View)) -> (View, View, Vec<Match>) {
    let matches = match_views(&a, &b);
    (a, b, matches)
}

fn flipped(pose: &Rigid, axes: DVec3) -> Rigid {
    Rigid { rotation: DMat3::from_diagonal(axes), translation: DVec3::ZERO } * *pose
}

/// Commits a pose mistake, written out from its definition and not by inverting the correction.
fn commit_pose(mistake: PoseMistake, right: &Rigid) -> Rigid {
    let opengl = |pose: &Rigid| flipped(pose, DVec3::new(1.0, -1.0, -1.0));
    let Rigid { rotation, translation } = *right;
    match mistake {
        PoseMistake::OpenGlAxes => opengl(right),
        PoseMistake::Inverse => right.inverse(),
        PoseMistake::InverseOpenGl => opengl(right).inverse(),
        PoseMistake::TransposedRotation => Rigid { rotation: rotation.transpose(), translation },
        PoseMistake::CentreAsTranslation => Rigid { rotation, translation: right.inverse().translation },
        PoseMistake::TranslationAsCentre => Rigid { rotation, translation: -(rotation * translation) },
        PoseMistake::TranslationSign => Rigid { rotation, translation: -translation },
        PoseMistake::LlffAxes => {
            let world_from_camera = right.inverse();
            let [right_axis, down, forward] = [0, 1, 2].map(|axis| world_from_camera.rotation.col(axis));
            Rigid { rotation: DMat3::from_cols(down, right_axis, -forward), ..world_from_camera }.inverse()
        }
        PoseMistake::HalfTurn => flipped(right, DVec3::new(-1.0, -1.0, 1.0)),
        PoseMistake::Exchanged => *right,
    }
}

fn commit(mistake: PoseMistake, a: &Camera, b: &Camera) -> (Camera, Camera) {
    let with = |camera: &Camera, pose: Rigid| Camera { camera_from_world: pose, ..*camera };
    match mistake {
        PoseMistake::Exchanged => (with(a, b.camera_from_world), with(b, a.camera_from_world)),
        _ => (with(a, commit_pose(mistake, &a.camera_from_world)), with(b, commit_pose(mistake, &b.camera_from_world))),
    }
}

fn scaled(camera: &Camera, x: f64, y: f64) -> Camera {
    let k = camera.intrinsics;
    Camera { intrinsics: Intrinsics { fx: k.fx * x, fy: k.fy * y, cx: k.cx * x, cy: k.cy * y }, ..*camera }
}

#[test]
fn right_cameras_are_good() {
    let (a, b, matches) = good_pair();
    let verdict = check_pair(&a.camera, &b.camera, matches);
    assert_eq!(verdict.status, Status::Good, "{verdict:?}");
    assert!(verdict.num_inliers > 100 && verdict.median_epipolar_px.unwrap() < 0.5, "{verdict:?}");
}

#[test]
fn every_pose_mistake_is_named() {
    let (a, b, matches) = good_pair();
    for mistake in PoseMistake::ALL {
        let (a, b) = commit(mistake, &a.camera, &b.camera);
        let verdict = check_pair(&a, &b, matches);
        assert_eq!(verdict.status, Status::Wrong, "{mistake:?}: {verdict:?}");
        assert_eq!(verdict.likely_cause, Some(Mistake::Pose(mistake)), "{verdict:?}");
    }
}

#[test]
fn the_sentence_says_what_to_do() {
    let (a, b, matches) = good_pair();
    let (a, b) = commit(PoseMistake::OpenGlAxes, &a.camera, &b.camera);
    let sentence = check_pair(&a, &b, matches).sentence;
    assert!(sentence.starts_with("The cameras look away from each other"), "{sentence}");
    assert!(sentence.contains("--axes opengl"), "{sentence}");
}

#[test]
fn normalised_intrinsics_are_named() {
    let (a, b, matches) = good_pair();
    let normalised = |c: &Camera| scaled(c, 1.0 / c.width as f64, 1.0 / c.height as f64);
    let verdict = check_pair(&normalised(&a.camera), &normalised(&b.camera), matches);
    assert_eq!(verdict.likely_cause, Some(Mistake::Intrinsics(IntrinsicsMistake::Normalised)), "{verdict:?}");
}

#[test]
fn intrinsics_of_another_resolution_are_named_with_the_factor() {
    let (a, b, matches) = good_pair();
    for factor in [0.25, 0.5, 1.5, 2.0, 3.0, 4.0, 5.2] {
        let verdict = check_pair(&scaled(&a.camera, factor, factor), &scaled(&b.camera, factor, factor), matches);
        assert_eq!(verdict.status, Status::Wrong, "{factor}: {verdict:?}");
        match verdict.likely_cause {
            Some(Mistake::Intrinsics(IntrinsicsMistake::OtherResolution(found))) => {
                assert!((found / factor - 1.0).abs() < 0.05, "{found} for {factor}");
            }
            other => panic!("{factor}: {other:?}"),
        }
    }
}

#[test]
fn intrinsics_of_other_proportions_are_named() {
    let (a, b, matches) = good_pair();
    let verdict = check_pair(&scaled(&a.camera, 2.0, 3.0), &scaled(&b.camera, 2.0, 3.0), matches);
    let Some(Mistake::Intrinsics(IntrinsicsMistake::OtherProportions(x, y))) = verdict.likely_cause else {
        panic!("{verdict:?}");
    };
    assert!((x - 2.0).abs() < 0.1 && (y - 3.0).abs() < 0.1, "{x} {y}");
}

#[test]
fn an_exchanged_principal_point_is_named() {
    let (a, b, matches) = good_pair();
    let exchanged = |c: &Camera| {
        let k = c.intrinsics;
        Camera { intrinsics: Intrinsics { cx: k.cy, cy: k.cx, ..k }, ..*c }
    };
    let verdict = check_pair(&exchanged(&a.camera), &exchanged(&b.camera), matches);
    let expected = Some(Mistake::Intrinsics(IntrinsicsMistake::PrincipalPointSwapped));
    assert_eq!(verdict.likely_cause, expected, "{verdict:?}");
}

#[test]
fn two_mistakes_at_once_are_named() {
    let (a, b, matches) = good_pair();
    let (a, b) = commit(PoseMistake::OpenGlAxes, &a.camera, &b.camera);
    let normalised = |c: &Camera| scaled(c, 1.0 / c.width as f64, 1.0 / c.height as f64);
    let verdict = check_pair(&normalised(&a), &normalised(&b), matches);
    let expected = Some(Mistake::Both(PoseMistake::OpenGlAxes, IntrinsicsMistake::Normalised));
    assert_eq!(verdict.likely_cause, expected, "{verdict:?}");
}

#[test]
fn the_correction_restores_the_right_cameras() {
    let (a, b, _) = good_pair();
    for mistake in PoseMistake::ALL {
        let (wrong_a, wrong_b) = commit(mistake, &a.camera, &b.camera);
        let (fixed_a, fixed_b) = Mistake::Pose(mistake).corrected_pair(&wrong_a, &wrong_b);
        for (fixed, right) in [(fixed_a, a.camera), (fixed_b, b.camera)] {
            let error = fixed.camera_from_world.to_mat4() - right.camera_from_world.to_mat4();
            let largest = error.to_cols_array().into_iter().fold(0.0f64, |m, v| m.max(v.abs()));
            assert!(largest < 1e-9, "{mistake:?}: {largest}");
        }
    }
}

#[test]
fn cameras_at_one_place_are_wrong_whatever_the_matches() {
    let (a, _, matches) = good_pair();
    for matches in [&matches[..], &[]] {
        let verdict = check_pair(&a.camera, &a.camera, matches);
        assert_eq!(verdict.status, Status::Wrong);
        assert!(verdict.sentence.contains("same place"), "{}", verdict.sentence);
    }
}

/// Cameras on a circle about the origin have one translation; inverted, they all stand at one place.
#[test]
fn an_inverted_orbit_about_the_origin_is_named() {
    let (_, _, matches) = good_pair();
    let orbit = options().cameras();
    let (a, b) = commit(PoseMistake::Inverse, &orbit[0], &orbit[1]);
    let verdict = check_pair(&a, &b, matches);
    assert_eq!(verdict.likely_cause, Some(Mistake::Pose(PoseMistake::Inverse)), "{verdict:?}");
}

#[test]
fn without_matches_good_cameras_are_not_judged() {
    let (a, b, _) = good_pair();
    assert_eq!(check_pair(&a.camera, &b.camera, &[]).status, Status::CannotTell);
    let wide = SceneOptions { pair_angle_deg: 60.0, ..options() }.cameras();
    let (a, b) = commit(PoseMistake::OpenGlAxes, &wide[0], &wide[1]);
    let hint = check_pair(&a, &b, &[]);
    assert_eq!(hint.status, Status::Suspicious, "cameras that look away from each other are odd: {hint:?}");
    assert_eq!(hint.likely_cause, Some(Mistake::Pose(PoseMistake::OpenGlAxes)));
}

#[test]
fn poisoned_cameras_and_matches_get_a_verdict_and_no_panic() {
    let (a, b, matches) = good_pair();
    for poison in [f64::NAN, f64::INFINITY, 0.0, -1.0, f64::MIN_POSITIVE, f64::MAX] {
        for field in 0..4 {
            let mut camera = a.camera;
            let k = &mut camera.intrinsics;
            *[&mut k.fx, &mut k.fy, &mut k.cx, &mut k.cy][field] = poison;
            assert_ne!(check_pair(&camera, &b.camera, matches).status, Status::Good, "{poison} in {field}");
        }
        let mut camera = a.camera;
        camera.camera_from_world.translation.x = poison;
        check_pair(&camera, &b.camera, matches);
        let mut poisoned = matches.clone();
        poisoned.iter_mut().step_by(3).for_each(|m| m.a.x = poison);
        check_pair(&a.camera, &b.camera, &poisoned);
    }
}

fn assert_no_alarm((a, b): (View, View), what: &str) -> Status {
    let (a, b, matches) = matched((a, b));
    let verdict = check_pair(&a.camera, &b.camera, &matches);
    let is_calm = matches!(verdict.status, Status::Good | Status::CannotTell);
    assert!(is_calm, "{what}: {verdict:?}");
    verdict.status
}

#[test]
fn scenes_of_every_kind_raise_no_alarm() {
    for kind in [SceneKind::Sphere, SceneKind::Torus, SceneKind::Boxes, SceneKind::Plane] {
        for pair_angle_deg in [3.0, 15.0] {
            let options = SceneOptions { kind, pair_angle_deg, supersampling: 1, noise: 0.02, ..options() };
            assert_no_alarm(pair_of(&options), &format!("{kind:?} at {pair_angle_deg} degrees"));
        }
    }
}

#[test]
fn little_texture_raises_no_alarm() {
    let options = SceneOptions { kind: SceneKind::Boxes, noise: 0.01, ..options() };
    let mut scene = options.scene();
    scene.objects.iter_mut().for_each(|object| object.texture = Texture::Solid([0.7, 0.7, 0.72]));
    let render = |i: usize| {
        let shot = RenderOptions { supersampling: 2, noise: 0.01, noise_seed: i as u64 };
        scene.render(&options.cameras()[i], "plain", &shot).view
    };
    assert_no_alarm((render(0), render(1)), "plain boxes");
}

#[test]
fn a_step_forward_raises_no_alarm() {
    let options = options();
    let scene = options.scene();
    let start = options.cameras()[0].centre();
    let rig = WalkRig {
        width: 320,
        height: 240,
        focal_per_width: 1.2,
        start,
        target: DVec3::ZERO,
        step: -start * 0.12,
        turn_deg: 1.0,
    };
    let shot = RenderOptions { supersampling: 2, ..RenderOptions::default() };
    let mut views = rig.cameras(2).into_iter().map(|camera| scene.render(&camera, "walk", &shot).view);
    let pair = (views.next().expect("two views"), views.next().expect("two views"));
    assert_eq!(assert_no_alarm(pair, "forward"), Status::Good);
}

/// A quarter turn of the second picture, with its camera: nothing has changed, only the pixels lie on their side.
#[test]
fn a_picture_on_its_side_raises_no_alarm() {
    let (a, b, _) = good_pair();
    let height = b.image.height();
    let image = Grid::from_fn(height, b.image.width(), |x, y| b.image[(y, height - 1 - x)]);
    let turn = DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z);
    let k = b.camera.intrinsics;
    let camera = Camera {
        intrinsics: Intrinsics { fx: k.fy, fy: k.fx, cx: height as f64 - k.cy, cy: k.cx },
        width: height,
        height: b.image.width(),
        camera_from_world: Rigid { rotation: turn, translation: DVec3::ZERO } * b.camera.camera_from_world,
    };
    assert_eq!(assert_no_alarm((a.clone(), View::new("turned", image, camera)), "quarter turn"), Status::Good);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Cameras anywhere about a cloud of points, pixels off by up to half a pixel, a fifth of the matches wrong.
    #[test]
    fn right_cameras_are_never_called_wrong(seed in 0u64..1_000_000, baseline in 0.02f64..0.8, unit in 1e-3f64..1e3) {
        let mut random = surfel_synth::Random::new(seed);
        let mut about = |reach: f64| DVec3::from_array([0.0; 3].map(|_| random.range(-reach, reach)));
        let middle = about(5.0);
        let eye = middle + 3.0 * about(1.0).normalize_or(DVec3::X);
        let camera = |centre: DVec3| surfel_synth::rig::centred_camera(
            480, 360, 520.0, surfel_synth::look_at(centre * unit, middle * unit),
        );
        let (a, b) = (camera(eye), camera(eye + baseline * about(1.0).normalize_or(DVec3::Y)));
        let matches: Vec<Match> = (0..150)
            .filter_map(|i| {
                let (pa, pb) = (a.project((middle + about(0.8)) * unit)?.0, about(0.5).truncate());
                let point = middle + about(0.8);
                let (right_a, right_b) = (a.project(point * unit)?.0, b.project(point * unit)?.0);
                let is_wrong = i % 5 == 0;
                Some(Match { a: if is_wrong { pa } else { right_a }, b: right_b + pb, score: 0.5 })
            })
            .collect();
        let verdict = check_pair(&a, &b, &matches);
        prop_assert_eq!(verdict.status, Status::Good, "{:?}", verdict);
    }
}
