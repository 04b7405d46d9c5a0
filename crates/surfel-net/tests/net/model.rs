//! Properties of the whole graph, with fresh weights.

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Gradients, Tensor};
use glam::{DQuat, DVec3};
use std::sync::Mutex;
use surfel_core::{Camera, Grid, Intrinsics, Rigid};
use surfel_net::{DepthRange, InputError, NetConfig, Prediction, Preset, SceneInput, SurfelNet, checkpoint};

pub(crate) struct Scene {
    pub(crate) images: Vec<Grid<[f32; 3]>>,
    pub(crate) cameras: Vec<Camera>,
    pub(crate) ranges: Vec<DepthRange>,
}

impl Scene {
    /// Views of nothing in particular from cameras side by side.
    pub(crate) fn new(views: usize, width: usize, height: usize, unit: f64) -> Self {
        let image = |v: usize| {
            Grid::from_fn(width, height, |x, y| {
                let phase = [0.0f32, 1.0, 2.0].map(|c| c + (0.37 * (x + 2 * v) as f32).sin() + 0.21 * y as f32);
                phase.map(|p| 0.5 + 0.4 * p.sin())
            })
        };
        let camera = |v: usize| Camera {
            intrinsics: Intrinsics {
                fx: 1.1 * width as f64,
                fy: 1.1 * width as f64,
                cx: 0.5 * width as f64,
                cy: 0.5 * height as f64,
            },
            width,
            height,
            camera_from_world: Rigid::from_quat(
                DQuat::from_rotation_y(0.05 * v as f64),
                DVec3::new(-0.3 * v as f64, 0.02, 0.01 * v as f64) * unit,
            ),
        };
        Self {
            images: (0..views).map(image).collect(),
            cameras: (0..views).map(camera).collect(),
            ranges: vec![DepthRange { near: 1.5 * unit, far: 6.0 * unit }; views],
        }
    }

    pub(crate) fn reversed(mut self) -> Self {
        self.images.reverse();
        self.cameras.reverse();
        self
    }

    pub(crate) fn input(&self) -> SceneInput<'_> {
        SceneInput { images: &self.images, cameras: &self.cameras, ranges: &self.ranges, seeds: &[] }
    }
}

/// Seeding and building must not interleave with other tests: the generator is shared.
static SEED: Mutex<()> = Mutex::new(());

pub(crate) fn net(config: NetConfig, device: &Device) -> SurfelNet {
    let _guard = SEED.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    device.seed(7);
    SurfelNet::new(config, device).unwrap()
}

fn tiny() -> NetConfig {
    NetConfig::preset(Preset::Tiny)
}

pub(crate) fn values<const D: usize>(tensor: &Tensor<D>) -> Vec<f32> {
    tensor.clone().into_data().try_into_vec().unwrap()
}

fn assert_close(a: &[f32], b: &[f32], tolerance: f32) {
    assert_eq!(a.len(), b.len());
    for (i, (a, b)) in a.iter().zip(b).enumerate() {
        assert!((a - b).abs() <= tolerance * (1.0 + a.abs().max(b.abs())), "{i}: {a} vs {b}");
    }
}

fn assert_valid(prediction: &Prediction, scene: &Scene) {
    let (views, width, height) = (scene.images.len(), scene.images[0].width(), scene.images[0].height());
    assert_eq!(prediction.maps.depth.dims(), [views, height, width]);
    let range = scene.ranges[0];
    let inside = |z: &f32| f64::from(*z) >= range.near * 0.9999 && f64::from(*z) <= range.far * 1.0001;
    assert!(values(&prediction.maps.depth).iter().all(inside));
    let surfels = prediction.surfels.to_surfels();
    assert_eq!(surfels.len(), views * width * height);
    assert!(surfels.is_consistent());
    assert!(surfels.scales.as_flattened().iter().all(|s| s.is_finite() && *s > 0.0));
    assert!(surfels.opacities.iter().all(|o| (0.0..=1.0).contains(o)));
    assert!(surfels.rotations.iter().all(|q| (q.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-3));
    assert!(surfels.sh.as_flattened().iter().all(|v| v.is_finite()));
    for (k, centre) in surfels.centres.iter().enumerate() {
        let (view, pixel) = (k / (width * height), k % (width * height));
        let (landed, _) = scene.cameras[view].project(DVec3::from(centre.map(f64::from))).unwrap();
        let expected = Camera::pixel_centre(pixel % width, pixel / width);
        assert!((landed - expected).length() < 1e-2, "surfel {k} left its pixel: {landed} vs {expected}");
    }
}

#[test]
fn any_number_of_views_of_any_size() {
    let device = Device::flex();
    let net = net(tiny(), &device);
    for (views, width, height) in [(2, 48, 32), (2, 37, 50), (3, 17, 9), (4, 20, 31)] {
        let scene = Scene::new(views, width, height, 1.0);
        assert_valid(&net.forward(&scene.input(), &device).unwrap(), &scene);
    }
}

#[test]
fn fresh_refined_surfels_are_the_initial_ones() {
    let device = Device::flex();
    let scene = Scene::new(2, 48, 32, 1.0);
    let prediction = net(tiny(), &device).forward(&scene.input(), &device).unwrap();
    assert!(prediction.adaptation.is_some());
    assert_eq!(prediction.initial.to_surfels(), prediction.surfels.to_surfels());
}

#[test]
fn the_switches_switch() {
    let device = Device::flex();
    let scene = Scene::new(2, 48, 32, 1.0);
    let mut config = tiny();
    config.aggregation.enabled = false;
    let prediction = net(config.clone(), &device).forward(&scene.input(), &device).unwrap();
    assert!(prediction.adaptation.is_none());
    config.aggregation.enabled = true;
    config.nyquist.adaptation = false;
    assert_valid(&net(config, &device).forward(&scene.input(), &device).unwrap(), &scene);
}

#[test]
fn swapping_views_swaps_outputs() {
    let device = Device::flex();
    let net = net(tiny(), &device);
    let forward = net.forward(&Scene::new(2, 48, 32, 1.0).input(), &device).unwrap();
    let swapped = net.forward(&Scene::new(2, 48, 32, 1.0).reversed().input(), &device).unwrap();
    let (a, b) = (values(&forward.maps.depth), values(&swapped.maps.depth));
    let half = a.len() / 2;
    assert_close(&a[..half], &b[half..], 1e-4);
    assert_close(&a[half..], &b[..half], 1e-4);
    assert!(a[..half].iter().zip(&a[half..]).any(|(a, b)| (a - b).abs() > 1e-3), "both views look the same");
}

#[test]
fn scaling_the_scene_scales_the_surfels() {
    let device = Device::flex();
    let net = net(tiny(), &device);
    let unit = 200.0;
    let one = net.forward(&Scene::new(2, 48, 32, 1.0).input(), &device).unwrap();
    let large = net.forward(&Scene::new(2, 48, 32, unit).input(), &device).unwrap();
    let scaled = |v: Vec<f32>| v.iter().map(|v| v * unit as f32).collect::<Vec<_>>();
    assert_close(&scaled(values(&one.maps.depth)), &values(&large.maps.depth), 1e-3);
    assert_close(&scaled(values(&one.surfels.scales)), &values(&large.surfels.scales), 1e-3);
    assert_close(&values(&one.surfels.rotations), &values(&large.surfels.rotations), 1e-3);
    assert_close(&values(&one.surfels.sh), &values(&large.surfels.sh), 1e-3);
}

/// Counts parameters that received a gradient, and those whose gradient is all zero.
struct GradientCount<'a> {
    grads: &'a Gradients,
    missing: usize,
    zero: usize,
    total: usize,
}

impl ModuleVisitor for GradientCount<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.total += 1;
        match param.val().grad(self.grads) {
            None => self.missing += 1,
            Some(grad) => self.zero += usize::from(values(&grad).iter().all(|v| *v == 0.0)),
        }
    }
}

#[test]
fn gradients_reach_every_parameter() {
    let device = Device::flex().autodiff();
    let net = net(tiny(), &device);
    let scene = Scene::new(2, 32, 32, 1.0);
    let prediction = net.forward(&scene.input(), &device).unwrap();
    let surfels = &prediction.surfels;
    let loss = prediction.maps.depth.clone().sum()
        + surfels.centres.clone().powi_scalar(2).sum()
        + surfels.scales.clone().log().sum()
        + surfels.rotations.clone().powi_scalar(3).sum()
        + surfels.sh.clone().sin().sum()
        + surfels.opacities.clone().sum();
    let grads = loss.backward();
    let mut visitor = GradientCount { grads: &grads, missing: 0, zero: 0, total: 0 };
    net.visit(&mut visitor);
    assert!(visitor.total > 100 && visitor.missing == 0, "{} of {} without gradient", visitor.missing, visitor.total);
    // Behind a layer that starts at zero the first gradient is zero.
    assert!(visitor.zero < visitor.total / 2, "{} of {} gradients are zero", visitor.zero, visitor.total);
}

#[test]
fn weights_survive_a_file_and_other_networks_refuse_it() {
    let device = Device::flex();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("net.safetensors");
    let scene = Scene::new(2, 32, 32, 1.0);
    let trained = net(tiny(), &device);
    checkpoint::save(&trained, &path).unwrap();
    let other = {
        let _guard = SEED.lock().unwrap();
        device.seed(99);
        SurfelNet::new(tiny(), &device).unwrap()
    };
    let depth = |net: &SurfelNet| values(&net.forward(&scene.input(), &device).unwrap().maps.depth);
    assert_ne!(depth(&trained), depth(&other));
    let loaded = checkpoint::load(other, &path).unwrap();
    assert_eq!(depth(&trained), depth(&loaded));
    let mut config = tiny();
    config.cost_volume.as_mut().unwrap().num_candidates = 18;
    let error = checkpoint::load(net(config, &device), &path).unwrap_err();
    assert!(error.to_string().contains("belongs to another network"), "{error}");
}

#[test]
fn unusable_scenes_are_refused_in_words() {
    let device = Device::flex();
    let net = net(tiny(), &device);
    let refusal = |scene: &Scene| net.forward(&scene.input(), &device).unwrap_err();
    assert_eq!(refusal(&Scene::new(1, 16, 16, 1.0)), InputError::TooFewViews(1));
    let mut scene = Scene::new(2, 16, 16, 1.0);
    scene.ranges[1].near = 0.0;
    assert!(matches!(refusal(&scene), InputError::Range { view: 1, .. }));
    let mut scene = Scene::new(2, 16, 16, 1.0);
    scene.images[1] = Grid::filled(15, 16, [0.0; 3]);
    assert!(matches!(refusal(&scene), InputError::Size { view: 1, found: (15, 16), .. }));
    let mut scene = Scene::new(2, 16, 16, 1.0);
    scene.images[0][(3, 3)][1] = f32::NAN;
    assert!(matches!(refusal(&scene), InputError::Pixel { view: 0 }));
    let mut scene = Scene::new(2, 16, 16, 1.0);
    scene.cameras[1].intrinsics.fx = f64::NAN;
    assert!(matches!(refusal(&scene), InputError::Camera { view: 1, .. }));
    let mut scene = Scene::new(2, 16, 16, 1.0);
    scene.cameras.pop();
    assert!(matches!(refusal(&scene), InputError::Lengths { .. }));
}
