//! The network whose coarse depth comes from matching.

use crate::model::{Scene, net, values};
use burn::tensor::Device;
use glam::{DQuat, DVec3};
use surfel_core::{Camera, Grid, Rigid};
use surfel_net::{InputError, NetConfig, Preset, SceneInput, Seed, SurfelNet};

/// The shipped graph, narrow, on the small backbone.
fn config() -> NetConfig {
    let mut config = NetConfig::preset(Preset::Tiny);
    let shipped = NetConfig::preset(Preset::Small);
    (config.transformer, config.cost_volume, config.seeded) = (None, None, shipped.seeded);
    config
}

/// A slanted plane `normal . X = offset` of the world, as matching would see it from each camera.
fn seeds(scene: &Scene, normal: DVec3, offset: f64) -> Vec<Seed> {
    let seed = |camera: &Camera| {
        let world_from_camera = camera.camera_from_world.inverse();
        let in_camera = camera.camera_from_world.rotation * normal;
        let distance = offset - normal.dot(world_from_camera.translation);
        let inverse = |x: f64, y: f64| in_camera.dot(camera.ray(glam::DVec2::new(x + 0.5, y + 0.5))) / distance;
        let (w_x, w_y) = (inverse(1.0, 0.0) - inverse(0.0, 0.0), inverse(0.0, 1.0) - inverse(0.0, 0.0));
        let planes = Grid::from_fn(camera.width, camera.height, |x, y| {
            [inverse(x as f64, y as f64) as f32, w_x as f32, w_y as f32]
        });
        let evidence = planes.map(|plane| [plane[0], 0.3]);
        let map = |value: f32| Grid::filled(camera.width, camera.height, value);
        let step = (0.01 / offset.abs()) as f32;
        Seed { planes, evidence, correlation: map(0.8), confidence: map(0.9), step }
    };
    scene.cameras.iter().map(seed).collect()
}

fn input<'a>(scene: &'a Scene, seeds: &'a [Seed]) -> SceneInput<'a> {
    SceneInput { images: &scene.images, cameras: &scene.cameras, ranges: &scene.ranges, seeds }
}

const AWAY: DVec3 = DVec3::new(0.2, -0.1, 0.974_679_434_480_896_3);

#[test]
fn a_fresh_network_returns_the_plane_and_lies_in_it() {
    let device = Device::flex();
    for (views, width, height) in [(2, 48, 32), (3, 37, 50)] {
        let scene = Scene::new(views, width, height, 1.0);
        let seeds = seeds(&scene, AWAY, 3.0);
        let prediction = net(config(), &device).forward(&input(&scene, &seeds), &device).unwrap();
        let depth = values(&prediction.maps.depth);
        let surfels = prediction.surfels.to_surfels();
        for k in 0..depth.len() {
            let (v, i) = (k / (width * height), k % (width * height));
            let expected = 1.0 / seeds[v].planes.as_slice()[i][0];
            assert!((depth[k] - expected).abs() < 1e-3 * expected, "{k}: {} vs {expected}", depth[k]);
            let centre = DVec3::from(surfels.centres[k].map(f64::from));
            assert!((AWAY.dot(centre) - 3.0).abs() < 5e-3, "surfel {k} is not on the plane");
        }
        let axis = |q: [f32; 4]| DQuat::from_xyzw(q[1].into(), q[2].into(), q[3].into(), q[0].into()) * DVec3::Z;
        assert!(surfels.rotations.iter().all(|q| axis(*q).dot(AWAY).abs() > 1.0 - 1e-4));
    }
}

#[test]
fn unit_and_range_do_not_matter_and_the_world_may_move() {
    let device = Device::flex();
    let net = net(config(), &device);
    let scene = Scene::new(2, 48, 32, 1.0);
    let one = net.forward(&input(&scene, &seeds(&scene, AWAY, 3.0)), &device).unwrap();
    let mut large = Scene::new(2, 48, 32, 500.0);
    large.ranges.iter_mut().for_each(|range| range.far *= 2.0);
    let other = net.forward(&input(&large, &seeds(&large, AWAY, 1500.0)), &device).unwrap();
    for (a, b) in values(&one.maps.depth).iter().zip(values(&other.maps.depth)) {
        assert!((500.0 * a - b).abs() < 2e-3 * b, "{a} vs {b}");
    }
    let mut moved = Scene::new(2, 48, 32, 1.0);
    let motion = Rigid::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.7, 1.1), DVec3::new(2.0, -5.0, 1.0));
    for camera in &mut moved.cameras {
        camera.camera_from_world = camera.camera_from_world * motion.inverse();
    }
    let normal = motion.rotation * AWAY;
    let seeds = seeds(&moved, normal, 3.0 + normal.dot(motion.translation));
    let turned = net.forward(&input(&moved, &seeds), &device).unwrap();
    let (before, after) = (one.surfels.to_surfels(), turned.surfels.to_surfels());
    for (a, b) in before.centres.iter().zip(&after.centres) {
        let expected = motion.transform(DVec3::from(a.map(f64::from)));
        assert!((expected - DVec3::from(b.map(f64::from))).length() < 2e-2, "{expected} vs {b:?}");
    }
}

#[test]
fn swapping_views_swaps_outputs() {
    let device = Device::flex();
    let net = net(config(), &device);
    let (scene, reversed) = (Scene::new(2, 48, 32, 1.0), Scene::new(2, 48, 32, 1.0).reversed());
    let a = values(&net.forward(&input(&scene, &seeds(&scene, AWAY, 3.0)), &device).unwrap().maps.depth);
    let b = values(&net.forward(&input(&reversed, &seeds(&reversed, AWAY, 3.0)), &device).unwrap().maps.depth);
    let half = a.len() / 2;
    assert!(a[..half].iter().zip(&b[half..]).all(|(a, b)| (a - b).abs() < 1e-4 * a));
}

#[test]
fn seeds_are_asked_for_and_checked() {
    let device = Device::flex();
    let net: SurfelNet = net(config(), &device);
    let scene = Scene::new(2, 32, 32, 1.0);
    let refusal = |seeds: &[Seed]| net.forward(&input(&scene, seeds), &device).unwrap_err();
    assert_eq!(refusal(&[]), InputError::Seeds { found: 0, expected: 2 });
    let mut bad = seeds(&scene, AWAY, 3.0);
    bad[1].planes[(3, 4)][0] = f32::NAN;
    assert_eq!(refusal(&bad), InputError::Seed { view: 1 });
    let mut bad = seeds(&scene, AWAY, 3.0);
    bad[0].confidence = Grid::filled(31, 32, 1.0);
    assert_eq!(refusal(&bad), InputError::Seed { view: 0 });
}
