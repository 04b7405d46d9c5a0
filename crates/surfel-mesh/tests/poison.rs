//! Bad numbers give a clean mesh or a precise error, never a panic and never an exploding volume.

mod scene;

use glam::DVec3;
use proptest::prelude::*;
use scene::*;
use surfel_core::{Grid, TriMesh};
use surfel_mesh::{DepthView, MaskConfig, MeshConfig, MeshError, TsdfConfig, fuse, mesh_from_views};

fn wall() -> Shot {
    let camera = looking_at(DVec3::ZERO, DVec3::Z, 48, 36, 40.0);
    Shot::take(camera, &plane(DVec3::Z * 2.0, DVec3::NEG_Z), &position_colour)
}

fn assert_clean(mesh: &TriMesh) {
    assert!(mesh.positions.iter().flatten().all(|c| c.is_finite()));
    assert!(mesh.normals.iter().all(|n| (n.iter().map(|c| c * c).sum::<f32>() - 1.0).abs() < 1e-4));
    assert!(mesh.triangles.iter().flatten().all(|v| (*v as usize) < mesh.positions.len()));
}

const POISON: [f32; 9] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, -0.0, 1e-30, 1e-40, 1e9, 3e38];

#[test]
fn poisoned_pixels_leave_the_rest_alone() {
    for value in POISON {
        let mut shot = wall();
        for pixel in [100, 777, 778, 900] {
            shot.depth.as_mut_slice()[pixel] = value;
            shot.colour.as_mut_slice()[pixel] = [value; 3];
        }
        let weight = Grid::from_fn(48, 36, |x, y| if (x, y) == (20, 20) { value } else { 1.0 });
        let view = DepthView { weight: Some(&weight), ..shot.view() };
        for mask in [MaskConfig::default(), MaskConfig::KEEP_ALL] {
            let config = MeshConfig { mask, ..MeshConfig::default() };
            let (mesh, report) = mesh_from_views(&[view], &config).unwrap_or_else(|e| panic!("{value}: {e}"));
            assert_clean(&mesh);
            assert!(mesh.triangles.len() > 1_000, "{value}: {report:?}");
            // A pixel of usable depth, however absurd, is a surface of its own far from the wall.
            let near: Vec<_> = mesh.positions.iter().filter(|p| (1.0..4.0).contains(&p[2])).collect();
            let flat = near.iter().filter(|p| (p[2] - 2.0).abs() < 1e-2).count();
            assert!(flat > 1_000 && flat * 100 > near.len() * 97, "{value}: {flat} of {}", near.len());
        }
    }
}

#[test]
fn nothing_to_mesh_is_said() {
    assert_eq!(mesh_from_views(&[], &MeshConfig::default()).unwrap_err(), MeshError::NoViews);
    assert_eq!(fuse(&[], &TsdfConfig::uniform(1.0)).unwrap_err(), MeshError::NoViews);
    let mut shot = wall();
    shot.depth = Grid::filled(48, 36, f32::NAN);
    let error = mesh_from_views(&[shot.view()], &MeshConfig::default()).unwrap_err();
    assert_eq!(error, MeshError::NoDepth { num_views: 1 });
    assert!(matches!(fuse(&[shot.view()], &TsdfConfig::uniform(1.0)), Err(MeshError::NoDepth { .. })));
}

#[test]
fn a_grid_of_another_size_is_named() {
    let (good, mut bad) = (wall(), wall());
    bad.colour = Grid::filled(47, 36, [0.0; 3]);
    let error = mesh_from_views(&[good.view(), bad.view()], &MeshConfig::default()).unwrap_err();
    assert!(error.to_string().starts_with("view 1: the colour is 47x36 but the camera is 48x36"), "{error}");
}

#[test]
fn unusable_settings_and_cameras_are_refused() {
    let mut shot = wall();
    for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let config = TsdfConfig { voxel: value, ..TsdfConfig::uniform(1.0) };
        assert!(matches!(fuse(&[shot.view()], &config), Err(MeshError::BadLength { .. })), "voxel {value}");
    }
    shot.camera.intrinsics.fx = f64::NAN;
    assert_eq!(fuse(&[shot.view()], &TsdfConfig::uniform(0.1)).unwrap_err(), MeshError::BadCamera { view: 0 });
}

#[test]
fn a_volume_that_does_not_fit_is_refused_before_it_is_allocated() {
    let shot = wall();
    let config = TsdfConfig { max_bytes: 1 << 20, ..TsdfConfig::uniform(0.005) };
    let error = fuse(&[shot.view()], &config).unwrap_err();
    assert!(matches!(error, MeshError::TooManyBlocks { limit_mib: 1, .. }), "{error}");
    // Every pixel is wider than 32 voxels: nothing is fused rather than a billion voxels.
    let config = TsdfConfig::uniform(1e-6);
    assert!(matches!(fuse(&[shot.view()], &config), Err(MeshError::NoDepth { .. })));
}

#[test]
fn tiny_images_do_not_trip() {
    for (width, height) in [(0, 0), (1, 1), (1, 5), (2, 2), (5, 1)] {
        let camera = looking_at(DVec3::ZERO, DVec3::Z, width, height, 4.0);
        let shot = Shot::take(camera, &plane(DVec3::Z * 2.0, DVec3::NEG_Z), &position_colour);
        let config = MeshConfig { mask: MaskConfig::KEEP_ALL, min_triangles: 0, ..MeshConfig::default() };
        if let Ok((mesh, _)) = mesh_from_views(&[shot.view()], &config) {
            assert_clean(&mesh);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn any_depth_map_is_survived(
        bits in prop::collection::vec(any::<u32>(), 12 * 9),
        voxel in prop::option::of(1e-6f64..1e6),
        radius in 1e-3f64..1e3,
    ) {
        let mut shot = wall();
        shot.camera = shot.camera.resized(12, 9);
        shot.depth = Grid::from_vec(12, 9, bits.iter().map(|bits| f32::from_bits(*bits)).collect());
        shot.colour = Grid::from_vec(12, 9, bits.iter().map(|bits| [f32::from_bits(bits.rotate_left(9)); 3]).collect());
        let tsdf = voxel.map(|voxel| TsdfConfig {
            uniform_radius: radius * voxel, max_bytes: 1 << 24, ..TsdfConfig::uniform(voxel)
        });
        let config = MeshConfig { mask: MaskConfig::KEEP_ALL, tsdf, min_triangles: 0, ..MeshConfig::default() };
        if let Ok((mesh, _)) = mesh_from_views(&[shot.view()], &config) {
            assert_clean(&mesh);
        }
    }
}
