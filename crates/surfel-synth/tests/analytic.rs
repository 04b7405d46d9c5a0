//! Analytic scenes against closed forms, finite differences and each other.

use glam::{DVec2, DVec3};
use surfel_core::{Camera, normals::normals_from_depth};
use surfel_synth::render::{NOTHING, SURROUNDINGS, pixel_ray};
use surfel_synth::texture::srgb_from_linear;
use surfel_synth::{
    Object, RenderOptions, RenderedView, Scene, SceneKind, SceneOptions, Shape, Texture, warp_statistics,
};

const KINDS: [SceneKind; 6] = SceneKind::ALL;

fn small(kind: SceneKind) -> SceneOptions {
    SceneOptions { kind, width: 96, height: 80, supersampling: 1, ..SceneOptions::default() }
}

#[test]
fn depth_of_a_sphere_is_the_closed_form() {
    let radius = 180.0;
    let options = SceneOptions { object_radius: radius, ground: false, ..small(SceneKind::Sphere) };
    let rendered = &options.render()[0];
    let camera = rendered.view.camera;
    let centre = camera.camera_from_world.transform(DVec3::ZERO);
    let mut num_hits = 0;
    for y in 0..80 {
        for x in 0..96 {
            let ray = camera.ray(Camera::pixel_centre(x, y));
            // |z ray - centre|² = radius², the smaller root.
            let (a, b, c) = (ray.length_squared(), ray.dot(centre), centre.length_squared() - radius * radius);
            let discriminant = b * b - a * c;
            let expected = if discriminant > 0.0 { (b - discriminant.sqrt()) / a } else { 0.0 };
            let depth = f64::from(rendered.depth[(x, y)]);
            assert!((depth - expected).abs() <= 1e-7 * expected, "{depth} {expected} at {x},{y}");
            if depth > 0.0 {
                num_hits += 1;
                let normal = (ray * expected - centre) / radius;
                let got = DVec3::from(rendered.normal[(x, y)].map(f64::from));
                assert!((got - normal).length() < 1e-6);
            }
        }
    }
    assert!(num_hits > 2000);
}

#[test]
fn depth_of_a_plane_is_the_closed_form() {
    let options = small(SceneKind::Plane);
    let plane = &options.scene().objects[0];
    let rendered = &options.render()[1];
    let camera = rendered.view.camera;
    let normal = camera.camera_from_world.rotation * plane.world_from_shape.rotation * DVec3::Z;
    let through = camera.camera_from_world.transform(DVec3::ZERO);
    for (x, y) in [(0, 0), (50, 40), (95, 79), (3, 70)] {
        let ray = camera.ray(Camera::pixel_centre(x, y));
        let expected = normal.dot(through) / normal.dot(ray);
        assert!((f64::from(rendered.depth[(x, y)]) / expected - 1.0).abs() < 1e-7);
    }
}

#[test]
fn normals_equal_finite_differences_of_depth() {
    for kind in KINDS {
        let options = SceneOptions { width: 192, height: 160, ..small(kind) };
        let rendered = &options.render()[0];
        let numeric = normals_from_depth(&rendered.depth, &rendered.view.camera.intrinsics);
        let mut angles = Vec::new();
        for y in 1..159 {
            for x in 1..191 {
                let exact = DVec3::from(rendered.normal[(x, y)].map(f64::from));
                if let Some(n) = numeric[(x, y)] {
                    assert!((exact.length() - 1.0).abs() < 1e-6);
                    let ray = rendered.view.camera.ray(Camera::pixel_centre(x, y));
                    assert!(exact.dot(ray) <= 0.0, "{kind:?}: the normal at {x},{y} faces away");
                    angles.push(exact.angle_between(DVec3::from(n.map(f64::from))).to_degrees());
                }
            }
        }
        angles.sort_by(f64::total_cmp);
        // Central differences are wrong across the depth edges only, a small part of the picture.
        let p90 = angles[angles.len() * 9 / 10];
        assert!(p90 < 1.0, "{kind:?}: 90% of normals agree within {p90} degrees");
    }
}

#[test]
fn one_view_warped_by_its_depth_looks_like_the_other() {
    for kind in KINDS {
        let options = SceneOptions { width: 144, height: 120, supersampling: 2, ..small(kind) };
        let views = options.render();
        let statistics = warp_statistics(&views[0], &views[1], 0.01);
        println!("{kind:?}: {statistics:?}");
        assert!(statistics.num_compared * 2 > statistics.num_with_depth, "{kind:?}");
        assert!(statistics.median < 0.03 && statistics.mean < 0.04, "{kind:?}: {statistics:?}");
        // The measure can fail: wrong depth gives a several times larger error.
        let mut wrong = views[0].clone();
        wrong.depth.as_mut_slice().iter_mut().for_each(|d| *d *= 1.02);
        let worse = warp_statistics(&wrong, &views[1], 0.05);
        assert!(worse.median > 1.8 * statistics.median, "{kind:?}: {worse:?} against {statistics:?}");
    }
}

#[test]
fn the_picture_depends_on_the_seed_but_not_on_the_number_of_threads() {
    let options = SceneOptions { noise: 0.02, seed: 3, ..small(SceneKind::StillLife) };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| options.render())
    };
    let (one, four) = (on(1), on(4));
    for (a, b) in one.iter().zip(&four) {
        assert_eq!(a.view.image, b.view.image);
        assert_eq!(a.depth, b.depth);
        assert_eq!(a.normal, b.normal);
    }
    let other = SceneOptions { seed: 4, ..options.clone() }.render();
    assert_ne!(one[0].view.image, other[0].view.image);
    assert_ne!(one[0].view.image, one[1].view.image);
}

#[test]
fn scaling_the_scene_scales_depth_and_keeps_the_picture() {
    for kind in KINDS {
        let options = small(kind);
        let large = SceneOptions { object_radius: options.object_radius * 64.0, ..options.clone() };
        let (a, b) = (&options.render()[0], &large.render()[0]);
        let same =
            a.depth.as_slice().iter().zip(b.depth.as_slice()).filter(|(a, b)| (*a * 64.0 - *b).abs() <= 1e-4 * *b);
        assert!(same.count() > 96 * 80 * 995 / 1000, "{kind:?}");
        let close = a.view.image.as_slice().iter().zip(b.view.image.as_slice());
        assert!(close.filter(|(a, b)| (a[1] - b[1]).abs() < 1e-3).count() > 96 * 80 * 99 / 100, "{kind:?}");
    }
}

#[test]
fn object_map_tells_objects_from_ground_and_backdrop() {
    let scene = Scene {
        objects: vec![
            Object::at(DVec3::new(0.0, 0.0, -1.0), Shape::Plane { half: DVec2::splat(1.5) }, Texture::Solid([0.5; 3]))
                .surroundings(),
            Object::at(DVec3::ZERO, Shape::Sphere { radius: 0.5 }, Texture::Solid([0.8; 3])),
        ],
        ..small(SceneKind::Sphere).scene()
    };
    let rig = surfel_synth::OrbitRig { distance: 5.0, ..surfel_synth::OrbitRig::dtu(96, 80) };
    let RenderedView { object, depth, .. } = scene.render(&rig.cameras(1)[0], "0", &RenderOptions::default());
    assert_eq!(object[(48, 40)], 1);
    for id in [NOTHING, SURROUNDINGS, 1] {
        assert!(object.as_slice().contains(&id), "{id} missing");
    }
    assert!(object.as_slice().iter().zip(depth.as_slice()).all(|(&id, &d)| (id == NOTHING) == (d == 0.0)));
}

#[test]
fn surface_samples_lie_on_the_surface_and_are_uniform_by_area() {
    for kind in KINDS {
        let options = small(kind);
        let scene = options.scene();
        let samples = scene.surface_samples(0, 2000, 5);
        for (p, n) in samples.points.iter().zip(&samples.normals) {
            assert!((n.length() - 1.0).abs() < 1e-9);
            let probe = surfel_synth::Ray { origin: *p + *n * 1e-3, direction: -*n };
            let hit = scene.objects[0].shape.intersect(&scene.objects[0].ray_in_shape(&probe), 0.0);
            assert!(hit.is_some_and(|hit| (hit.t - 1e-3).abs() < 1e-5), "{kind:?} at {p}");
        }
        let visible = scene.visible_samples(&samples, &options.cameras());
        assert!(visible.points.len() > 100 && visible.points.len() < 2000, "{kind:?}: {}", visible.points.len());
    }
    // Archimedes: the z coordinate of a uniform point on a sphere is uniform.
    let scene = SceneOptions { object_radius: 1.0, ..small(SceneKind::Sphere) }.scene();
    let samples = scene.surface_samples(0, 8000, 1);
    for i in 0..8 {
        let low = -1.0 + 0.25 * f64::from(i);
        let inside = samples.points.iter().filter(|p| p.z >= low && p.z < low + 0.25).count();
        assert!((850..1150).contains(&inside), "{inside} of 8000 in one eighth");
    }
}

#[test]
fn samples_at_a_spacing_are_as_many_as_the_area_asks_for() {
    let (radius, spacing) = (180.0, 4.0);
    let count = |kind: SceneKind, radius: f64| {
        let scene = SceneOptions { object_radius: radius, ..small(kind) }.scene();
        scene.object_samples(spacing, 2).points.len() as f64 * spacing * spacing
    };
    let sphere = 4.0 * std::f64::consts::PI * radius * radius;
    assert!((count(SceneKind::Sphere, radius) / sphere - 1.0).abs() < 0.03);
    let plane = (6.0 * radius).powi(2);
    assert!((count(SceneKind::Plane, radius) / plane - 1.0).abs() < 0.03);
}

#[test]
fn colours_equal_those_of_tracing_every_colour_ray() {
    for kind in KINDS {
        let options = SceneOptions { supersampling: 2, ..small(kind) };
        let (scene, camera) = (options.scene(), options.cameras()[0]);
        let rendered = &options.render()[0];
        let mut errors = Vec::new();
        for y in (0..80).step_by(2) {
            for x in 0..96 {
                let slow: glam::Vec3 = (0..4)
                    .map(|i| {
                        let offset = DVec2::new(f64::from(i % 2) + 0.5, f64::from(i / 2) + 0.5) / 2.0;
                        scene.radiance(&pixel_ray(&camera, DVec2::new(x as f64, y as f64) + offset))
                    })
                    .sum();
                let fast = rendered.view.image[(x, y)];
                let worst = (slow / 4.0).to_array().into_iter().zip(fast).map(|(s, f)| (srgb_from_linear(s) - f).abs());
                errors.push(worst.fold(0.0, f32::max));
            }
        }
        errors.sort_by(f32::total_cmp);
        // Half an eight-bit step nearly everywhere; near edges thinner than a pixel the centre ray cannot know.
        let (p95, p99) = (errors[errors.len() * 95 / 100], errors[errors.len() * 99 / 100]);
        assert!(p95 < 0.004 && p99 < 0.03, "{kind:?}: {p95} {p99}");
    }
}
