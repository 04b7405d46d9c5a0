//! The mesh renderer against its slow obvious twin, on small meshes made here.
#![cfg(feature = "assets")]

use glam::{DMat3, DQuat, DVec3, Vec2, Vec3};
use std::f32::consts::TAU;
use std::sync::Arc;
use surfel_core::{Camera, Similarity, normals::normals_from_depth};
use surfel_synth::assets::backdrop::Backdrop;
use surfel_synth::assets::glb::{Glb, Primitive, read_glb};
use surfel_synth::assets::instance::{Instance, Paint};
use surfel_synth::assets::light::{Irradiance, Lamp};
use surfel_synth::assets::mesh::TexturedMesh;
use surfel_synth::assets::panel::Panel;
use surfel_synth::assets::photograph::photograph;
use surfel_synth::assets::stage::Stage;
use surfel_synth::assets::texels::Texels;
use surfel_synth::render::{NOTHING, SURROUNDINGS, pixel_ray};
use surfel_synth::{OrbitRig, Random, SynthScene, Texture, warp_statistics};

/// A torus of `rings` x `sides` quads.
fn torus(rings: u32, sides: u32) -> Primitive {
    let mut positions = Vec::new();
    for i in 0..rings {
        for j in 0..sides {
            let (a, b) = (i as f32 / rings as f32 * TAU, j as f32 / sides as f32 * TAU);
            let r = 0.7 + 0.3 * b.cos();
            positions.push([r * a.cos(), r * a.sin(), 0.3 * b.sin()]);
        }
    }
    let vertex = |i: u32, j: u32| i % rings * sides + j % sides;
    let mut triangles = Vec::new();
    for i in 0..rings {
        for j in 0..sides {
            let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    Primitive { positions, uvs: Vec::new(), triangles, base_colour: [0.8; 3], image: None, roughness: 1.0 }
}

fn mesh(primitive: Primitive) -> TexturedMesh {
    TexturedMesh::new(&Glb { primitives: vec![primitive], images: Vec::new() }, &[], false).unwrap()
}

/// Nearest hit by trying every triangle in `f64`.
fn brute_force(triangles: &[[DVec3; 3]], origin: DVec3, direction: DVec3) -> Option<(f64, DVec3)> {
    let hits = triangles.iter().filter_map(|&[a, b, c]| {
        let m = DMat3::from_cols(b - a, c - a, -direction);
        let solved = m.inverse() * (origin - a);
        let inside = solved.is_finite() && solved.x >= 0.0 && solved.y >= 0.0 && solved.x + solved.y <= 1.0;
        (inside && solved.z > 0.0).then(|| (solved.z, (b - a).cross(c - a).normalize()))
    });
    hits.min_by(|a, b| a.0.total_cmp(&b.0))
}

fn world_triangles(instance: &Instance) -> Vec<[DVec3; 3]> {
    let all = 0..instance.mesh.num_triangles();
    all.map(|i| instance.mesh.positions(i).map(|p| instance.world_from_mesh.transform(p.as_dvec3()))).collect()
}

/// Two tori and a table.
fn stage() -> Stage {
    let shape = Arc::new(mesh(torus(24, 12)));
    let place = |x: f64, turn: f64, scale: f64| Instance {
        mesh: Arc::clone(&shape),
        world_from_mesh: Similarity {
            scale,
            rotation: DMat3::from_quat(DQuat::from_rotation_x(turn)),
            translation: DVec3::new(x, 0.3 * x, 0.2 * scale),
        },
        paint: Paint::Procedural(Texture::Noise { seed: 1, size: 0.4, octaves: 4, colours: [[0.2; 3], [0.9; 3]] }),
        gloss: 0.0,
        shininess: 10.0,
    };
    let checker =
        image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([if (x / 8 + y / 8) % 2 == 0 { 220 } else { 90 }; 3]));
    let table = Panel {
        centre: DVec3::Z * -90.0,
        half: [DVec3::X * 400.0, DVec3::Y * 350.0],
        image: Arc::new(Texels::new(&checker.into())),
        repeats: Vec2::splat(3.0),
        tint: Vec3::ONE,
        openness: None,
    };
    Stage {
        instances: vec![place(-80.0, 0.4, 130.0), place(110.0, 1.3, 90.0)],
        panels: vec![table],
        lamps: vec![Lamp { direction: Vec3::new(0.3, -0.4, 0.87).normalize(), spread: 0.1, colour: Vec3::ONE }],
        irradiance: Irradiance::from_equirect(16, &[Vec3::splat(0.4); 128]),
        bounce: Vec3::splat(0.1),
        backdrop: Backdrop::Flat(Vec3::splat(0.02)),
        radius: 200.0,
    }
}

fn cameras() -> Vec<Camera> {
    OrbitRig { elevation_deg: 25.0, ..OrbitRig::dtu(120, 96) }.cameras(2)
}

#[test]
fn rays_meet_what_a_loop_over_all_triangles_meets() {
    let stage = stage();
    let triangles: Vec<_> = stage.instances.iter().flat_map(world_triangles).collect();
    let mut random = Random::new(3);
    let (mut num_hits, mut num_rays_at_edges) = (0, 0);
    for _ in 0..3000 {
        let origin = random.direction() * 600.0;
        let direction = random.direction() * 150.0 - origin;
        let ray = surfel_synth::Ray { origin, direction };
        let fast = stage.instances.iter().filter_map(|i| i.intersect(&ray, f64::INFINITY)).map(|h| f64::from(h.t));
        let fast = fast.min_by(f64::total_cmp);
        let slow = brute_force(&triangles, origin, direction).map(|(t, _)| t);
        match (fast, slow) {
            (Some(a), Some(b)) if (a - b).abs() < 1e-4 * b => num_hits += 1,
            (None, None) => {}
            _ => num_rays_at_edges += 1,
        }
    }
    assert!(num_hits > 800, "{num_hits}");
    // A ray within rounding of a silhouette may go either way.
    assert!(num_rays_at_edges <= 3, "{num_rays_at_edges}");
}

#[test]
fn pictures_carry_the_depth_and_normal_of_the_twin() {
    let stage = stage();
    let camera = cameras()[0];
    let rendered = photograph(&stage, &camera, "0");
    let mut triangles: Vec<_> = stage.instances.iter().flat_map(world_triangles).collect();
    let table = &stage.panels[0];
    let corner = |u: f64, v: f64| table.centre + table.half[0] * u + table.half[1] * v;
    triangles.push([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0)]);
    triangles.push([corner(-1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    let mut num_different = 0;
    for y in (0..96).step_by(2) {
        for x in (0..120).step_by(2) {
            let ray = pixel_ray(&camera, Camera::pixel_centre(x, y));
            let expected = brute_force(&triangles, ray.origin, ray.direction);
            let depth = rendered.depth[(x, y)];
            let agrees = match expected {
                None => depth == 0.0,
                Some((t, normal)) => {
                    let facing = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
                    let facing = (camera.camera_from_world.rotation * facing).as_vec3();
                    let close = (f64::from(depth) - t).abs() < 1e-6 * t;
                    close && facing.distance(Vec3::from(rendered.normal[(x, y)])) < 1e-4
                }
            };
            num_different += usize::from(!agrees);
        }
    }
    assert!(num_different <= 3, "{num_different} of {} pixels differ", 60 * 48);
}

#[test]
fn mask_and_depth_agree_and_normals_follow_depth() {
    let stage = stage();
    let rendered = photograph(&stage, &cameras()[1], "1");
    let pixels = rendered.object.as_slice().iter().zip(rendered.depth.as_slice()).zip(rendered.normal.as_slice());
    for ((&object, &depth), normal) in pixels {
        assert_eq!(object == NOTHING, depth == 0.0);
        let length = Vec3::from(*normal).length();
        assert!(if object == NOTHING { length == 0.0 } else { (length - 1.0).abs() < 1e-5 });
    }
    for id in [NOTHING, SURROUNDINGS, 1, 2] {
        assert!(rendered.object.as_slice().contains(&id), "object {id} is not in the picture");
    }
    let numeric = normals_from_depth(&rendered.depth, &rendered.view.camera.intrinsics);
    let pairs = numeric.as_slice().iter().zip(rendered.normal.as_slice());
    let mut angles: Vec<f32> =
        pairs.filter_map(|(n, exact)| Some(Vec3::from((*n)?).angle_between(Vec3::from(*exact)).to_degrees())).collect();
    angles.sort_by(f32::total_cmp);
    // Differences reach across the edges between facets; inside facets they must agree.
    assert!(angles[angles.len() / 2] < 0.5, "median {} degrees", angles[angles.len() / 2]);
}

#[test]
fn views_of_a_stage_are_photo_consistent() {
    let stage = stage();
    let views: Vec<_> = cameras().iter().map(|camera| photograph(&stage, camera, "v")).collect();
    let statistics = warp_statistics(&views[0], &views[1], 0.01);
    assert!(statistics.num_compared > 4000 && statistics.mean < 0.03, "{statistics:?}");
}

#[test]
fn flat_and_tiny_meshes_are_hit() {
    let single = Primitive {
        positions: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]],
        uvs: Vec::new(),
        triangles: vec![[0, 1, 2]],
        base_colour: [1.0; 3],
        image: None,
        roughness: 1.0,
    };
    let mesh = mesh(single);
    let hit = mesh.intersect(Vec3::new(-0.2, -0.2, 3.0), Vec3::NEG_Z, 0.0, f32::INFINITY).unwrap();
    assert!((hit.t - 3.0).abs() < 1e-5);
    assert!(mesh.intersect(Vec3::new(0.6, 0.6, 3.0), Vec3::NEG_Z, 0.0, f32::INFINITY).is_none());
    let empty = Primitive { triangles: Vec::new(), ..torus(3, 3) };
    assert!(TexturedMesh::new(&Glb { primitives: vec![empty], images: Vec::new() }, &[], false).is_none());
}

/// One triangle as a GLB file.
fn triangle_glb() -> Vec<u8> {
    let floats = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let mut binary: Vec<u8> = floats.iter().flat_map(|v| v.to_le_bytes()).collect();
    binary.extend([0u16, 1, 2, 0].iter().flat_map(|v| v.to_le_bytes()));
    let json = br#"{"asset":{"version":"2.0"},"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
        {"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}],
        "bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":6}]}"#;
    let mut json = json.to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    let total = 12 + 8 + json.len() + 8 + binary.len();
    file.extend([2u32, total as u32, json.len() as u32, 0x4e4f_534a].iter().flat_map(|v| v.to_le_bytes()));
    file.extend(json);
    file.extend([binary.len() as u32, 0x004e_4942].iter().flat_map(|v| v.to_le_bytes()));
    file.extend(binary);
    file
}

#[test]
fn a_glb_file_is_read() {
    let file = triangle_glb();
    let glb = read_glb(&file).unwrap();
    assert_eq!(glb.primitives[0].triangles, [[0, 1, 2]]);
    assert_eq!(glb.primitives[0].positions[2], [0.0, 1.0, 0.0]);
}

proptest::proptest! {
    #[test]
    fn broken_glb_files_give_an_error_or_a_sound_mesh(
        cut in 0usize..700, changes in proptest::collection::vec((0usize..700, 0u8..), 0..6)
    ) {
        let mut file = triangle_glb();
        for (at, value) in changes {
            let at = at % file.len();
            file[at] = value;
        }
        file.truncate(file.len().saturating_sub(cut.saturating_sub(350)));
        if let Ok(glb) = read_glb(&file) {
            for primitive in glb.primitives {
                let count = primitive.positions.len() as u32;
                assert!(primitive.triangles.iter().flatten().all(|&i| i < count));
            }
        }
    }
}

#[test]
fn rays_through_shared_edges_do_not_leak() {
    let sphere = mesh(torus(40, 20));
    // Rays aimed exactly at vertices and edge middles from outside must hit at or before them.
    for i in 0..sphere.num_triangles() {
        let [a, b, c] = sphere.positions(i);
        let outward = (b - a).cross(c - a).normalize();
        for target in [a, 0.5 * (a + b), 0.5 * (b + c)] {
            let hit = sphere.intersect(target + outward * 0.05, -outward, 0.0, 0.2);
            assert!(hit.is_some(), "a ray slips through triangle {i} at {target}");
        }
    }
}

#[test]
fn exact_samples_lie_on_the_objects_cover_what_is_seen_and_nothing_else() {
    let scene = SynthScene { stage: stage(), cameras: cameras(), sensors: Vec::new() };
    let triangles: Vec<_> = scene.stage.instances.iter().flat_map(world_triangles).collect();
    let mesh = scene.object_mesh();
    assert_eq!(mesh.triangles.len(), triangles.len());
    let spacing = 8.0;
    let samples = scene.seen_samples(spacing, 1);
    assert!(samples.points.len() > 300, "{}", samples.points.len());
    for (p, n) in samples.points.iter().zip(&samples.normals) {
        let on = |t: &[DVec3; 3]| {
            let normal = (t[1] - t[0]).cross(t[2] - t[0]).normalize();
            normal.dot(*n) > 1.0 - 1e-9 && (*p - t[0]).dot(normal).abs() < 1e-6
        };
        assert!(triangles.iter().any(on), "{p} is on no triangle");
        let reached = |camera: &Camera| {
            let direction = *p - camera.centre();
            brute_force(&triangles, camera.centre(), direction).is_none_or(|(t, _)| t > 1.0 - 1e-3)
        };
        assert!(scene.cameras.iter().any(reached), "{p} is hidden");
    }
    // Uniform by area: as many points per area as the spacing says, on everything that a camera sees.
    let area = |t: &[DVec3; 3]| 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).length();
    let seen: f64 = triangles
        .iter()
        .filter(|t| scene.cameras.iter().any(|camera| scene.sees(camera, (t[0] + t[1] + t[2]) / 3.0)))
        .map(area)
        .sum();
    let expected = seen / (spacing * spacing);
    let ratio = samples.points.len() as f64 / expected;
    assert!((ratio - 1.0).abs() < 0.1, "{} points, {expected} expected", samples.points.len());
}
