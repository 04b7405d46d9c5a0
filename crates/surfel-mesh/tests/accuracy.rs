//! Perfect depth in, how good a surface out.

mod scene;

use glam::DVec3;
use scene::*;
use surfel_mesh::{MaskConfig, MeshConfig, TsdfConfig, filter_components, fuse, mesh_from_views};

/// A fiftieth of the sphere's radius: the truncation band behind a silhouette then ends inside the sphere, as it
/// does on anything worth meshing.
const VOXEL: f64 = 0.02;

fn sphere_mesh() -> surfel_core::TriMesh {
    let config = MeshConfig { tsdf: Some(TsdfConfig::uniform(VOXEL)), ..MeshConfig::default() };
    mesh_from_views(&views(&sphere_shots(320)), &config).unwrap().0
}

#[test]
fn sphere_seen_all_around_is_closed_and_round() {
    let mesh = sphere_mesh();
    assert!(mesh.triangles.len() > 10_000, "{} triangles", mesh.triangles.len());
    let errors: Vec<f64> =
        (0..mesh.positions.len()).map(|v| (position(&mesh, v as u32).length() - 1.0).abs()).collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64 / VOXEL;
    let worst = errors.iter().copied().fold(0.0, f64::max) / VOXEL;
    eprintln!("sphere: mean error {mean:.4} voxel, worst {worst:.3} voxel");
    assert!(mean < 0.05, "mean error {mean} voxel");
    assert!(worst < 0.5, "worst error {worst} voxel");
    assert!(edge_uses(&mesh).values().all(|uses| uses.len() == 2), "the sphere has a hole");
    assert_manifold(&mesh);
    assert_no_repeated_vertex(&mesh);
    let euler = mesh.positions.len() as i64 - edge_uses(&mesh).len() as i64 + mesh.triangles.len() as i64;
    assert_eq!(euler, 2, "not a topological sphere");
}

#[test]
fn normals_and_winding_point_outward_and_colours_are_the_surfaces() {
    let mesh = sphere_mesh();
    for (vertex, (normal, colour)) in mesh.normals.iter().zip(&mesh.colours).enumerate() {
        let p = position(&mesh, vertex as u32);
        let normal = DVec3::from_array(normal.map(f64::from));
        assert!((normal.length() - 1.0).abs() < 1e-5);
        assert!(normal.dot(p.normalize()) > 0.97, "normal {normal} at {p}");
        for (channel, truth) in colour.iter().zip(position_colour(p)) {
            assert!((f32::from(*channel) / 255.0 - truth).abs() < 0.02, "colour {colour:?} at {p}");
        }
    }
    for triangle in 0..mesh.triangles.len() {
        let normal = winding_normal(&mesh, triangle);
        assert!(normal.length() > 0.0, "degenerate triangle {triangle}");
        // Slivers may lean; they must not lie on their back.
        assert!(normal.dot(position(&mesh, mesh.triangles[triangle][0])) > 0.0, "triangle {triangle} faces inward");
    }
}

#[test]
fn slanted_plane_is_exact_and_has_no_hole() {
    let normal = DVec3::new(0.5, -0.3, -0.8).normalize();
    let hit = plane(DVec3::Z * 5.0, normal);
    let camera = looking_at(DVec3::ZERO, DVec3::Z, 120, 90, 100.0);
    let shot = Shot::take(camera, &hit, &position_colour);
    let mesh = fuse(&[shot.view()], &TsdfConfig::uniform(0.05)).unwrap().extract();
    for vertex in 0..mesh.positions.len() {
        let p = position(&mesh, vertex as u32);
        // Vertices keep 1/256 of an edge away from the voxels.
        assert!(normal.dot(p - DVec3::Z * 5.0).abs() < 0.05 / 250.0, "{p} is off the plane");
    }
    assert_manifold(&mesh);
    for ((a, b), uses) in edge_uses(&mesh) {
        let pixel = pixel_of(&camera, (position(&mesh, a) + position(&mesh, b)) / 2.0);
        let interior = pixel.x > 4.0 && pixel.y > 4.0 && pixel.x < 115.0 && pixel.y < 85.0;
        assert!(!interior || uses.len() == 2, "hole at pixel {pixel}");
    }
}

#[test]
fn ground_seen_at_a_grazing_angle_is_exact_and_has_no_hole() {
    // Ground one unit below the eye, from 4 to 15 units away: 76 to 86 degrees, up to 5 % of depth from row to row.
    let normal = DVec3::new(0.02, -1.0, -0.01).normalize();
    let ground = plane(DVec3::Y, normal);
    let hit = move |from: DVec3, ray: DVec3| ground(from, ray).filter(|z| (4.0..15.0).contains(z));
    let camera = looking_at(DVec3::ZERO, DVec3::Z, 80, 160, 300.0);
    let shot = Shot::take(camera, &hit, &position_colour);
    for (mask, far) in [(MaskConfig::KEEP_ALL, 12.5), (MaskConfig::default(), 8.5)] {
        let config = MeshConfig { mask, tsdf: Some(TsdfConfig::uniform(0.02)), ..MeshConfig::default() };
        let (mesh, report) = mesh_from_views(&[shot.view()], &config).unwrap();
        assert_eq!(report.components.num_kept, 1, "{report:?}");
        for vertex in 0..mesh.positions.len() {
            let p = position(&mesh, vertex as u32);
            // The last row may hold a single pixel, which knows no slope along it.
            assert!(p.z > 14.0 || normal.dot(p - DVec3::Y).abs() < 0.02 / 100.0, "{p} is off the ground");
        }
        let near = 4.5;
        for ((a, b), uses) in edge_uses(&mesh) {
            let middle = (position(&mesh, a) + position(&mesh, b)) / 2.0;
            let pixel = pixel_of(&camera, middle);
            let interior = middle.z > near && middle.z < far && pixel.x > 6.0 && pixel.x < 73.0;
            assert!(!interior || uses.len() == 2, "hole at {middle}");
        }
        let reach = |end: fn(f32, f32) -> f32| mesh.positions.iter().map(|p| p[2]).reduce(end).unwrap();
        assert!(reach(f32::min) < near as f32 && reach(f32::max) > far as f32, "{report:?}");
    }
}

#[test]
fn pixels_wider_than_blocks_leave_no_hole() {
    let hit = plane(DVec3::Z * 5.0, DVec3::new(0.2, 0.1, -1.0).normalize());
    let camera = looking_at(DVec3::ZERO, DVec3::Z, 12, 10, 10.0);
    let shot = Shot::take(camera, &hit, &position_colour);
    // A pixel is half a unit wide: 25 voxels, three blocks.
    let config = TsdfConfig { max_depth_jump: 0.1, ..TsdfConfig::uniform(0.02) };
    let mesh = fuse(&[shot.view()], &config).unwrap().extract();
    for ((a, b), uses) in edge_uses(&mesh) {
        let pixel = pixel_of(&camera, (position(&mesh, a) + position(&mesh, b)) / 2.0);
        let interior = pixel.min_element() > 0.0 && pixel.x < 11.0 && pixel.y < 9.0;
        assert!(!interior || uses.len() == 2, "hole at pixel {pixel}");
    }
}

#[test]
fn depth_edges_grow_no_walls() {
    let shots = sphere_and_wall();
    let config = MeshConfig { tsdf: Some(TsdfConfig::uniform(0.03)), ..MeshConfig::default() };
    let (mesh, report) = mesh_from_views(&views(&shots), &config).unwrap();
    assert_eq!(report.components.num_kept, 2, "a ball and a wall: {report:?}");
    for vertex in 0..mesh.positions.len() {
        let p = position(&mesh, vertex as u32);
        let to_ball = ((p - DVec3::new(0.1, 0.0, 3.0)).length() - 0.5).abs();
        let to_wall = (p - DVec3::Z * 4.5).dot(DVec3::new(0.3, 0.1, -1.0).normalize()).abs();
        assert!(to_ball.min(to_wall) < 0.03, "{p} belongs to nothing: {to_ball} {to_wall}");
    }
}

#[test]
fn a_landscape_from_1_to_100_is_one_mesh_per_thing() {
    // A boulder at 1.5, ground up to where it grazes, and a mountain from 80 to 100: pixels from 0.01 to 0.7.
    let boulder = sphere(DVec3::new(0.3, 0.7, 2.0), 0.5);
    let ground = plane(DVec3::Y * 1.2, DVec3::new(0.0, -1.0, -0.05).normalize());
    let mountain = sphere(DVec3::new(0.0, 30.0, 140.0), 60.0);
    let hit = move |from: DVec3, ray: DVec3| {
        let hits = [boulder(from, ray), ground(from, ray).filter(|z| *z < 40.0), mountain(from, ray)];
        hits.into_iter().flatten().reduce(f64::min)
    };
    let shots: Vec<Shot> = [-0.2, 0.2]
        .map(|x| {
            let camera = looking_at(DVec3::X * x, DVec3::new(0.0, 0.3, 3.0), 160, 120, 130.0);
            Shot::take(camera, &hit, &position_colour)
        })
        .to_vec();
    let (mesh, report) = mesh_from_views(&views(&shots), &MeshConfig::default()).unwrap();
    let (low, high) = mesh.bounds().unwrap();
    assert!(low[2] < 2.0 && high[2] > 80.0, "from {low:?} to {high:?}");
    for vertex in 0..mesh.positions.len() {
        let p = position(&mesh, vertex as u32);
        let to_ground = (p - DVec3::Y * 1.2).dot(DVec3::new(0.0, -1.0, -0.05).normalize()).abs();
        let to_boulder = (p.distance(DVec3::new(0.3, 0.7, 2.0)) - 0.5).abs();
        let to_mountain = (p.distance(DVec3::new(0.0, 30.0, 140.0)) - 60.0).abs();
        let off = to_ground.min(to_boulder).min(to_mountain);
        assert!(off < 0.01 * p.z, "{p} belongs to nothing: {off}");
    }
    // The boulder, the ground to its left and right, and the mountain; the rest must be crumbs.
    let half_a_percent = mesh.triangles.len() / 200;
    let (_, large) = filter_components(&mesh, 50, half_a_percent);
    assert!((3..=4).contains(&large.num_kept), "{large:?}");
    assert!(large.removed_triangles + report.components.removed_triangles < half_a_percent, "speckles: {report:?}");
    assert!(report.num_blocks < 15_000);
    assert_manifold(&mesh);
}
