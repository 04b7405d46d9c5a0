//! The sparse field and the sharing extraction against their slow twins.

mod scene;

use glam::{DVec3, IVec3};
use scene::*;
use surfel_core::{Grid, TriMesh};
use surfel_mesh::{DepthView, Tsdf, TsdfConfig, brute, fuse};

/// Depth maps with holes, edges and uneven weights.
fn holed_shots() -> (Vec<Shot>, Vec<Grid<f32>>) {
    let mut shots = sphere_and_wall();
    let (width, height) = (shots[0].camera.width, shots[0].camera.height);
    for shot in &mut shots {
        for pixel in (0..width * height).filter(|pixel| pixel % 97 == 0) {
            shot.depth.as_mut_slice()[pixel] = 0.0;
        }
    }
    let weight = |seed: usize| Grid::from_fn(width, height, |x, y| ((x * 7 + y * 13 + seed) % 11) as f32 / 10.0);
    (shots, vec![weight(0), weight(5)])
}

fn weighted<'a>(shots: &'a [Shot], weights: &'a [Grid<f32>]) -> Vec<DepthView<'a>> {
    shots.iter().zip(weights).map(|(shot, weight)| DepthView { weight: Some(weight), ..shot.view() }).collect()
}

fn configs() -> [TsdfConfig; 2] {
    // The second compresses the far half of the scene.
    [TsdfConfig::uniform(0.04), TsdfConfig { uniform_radius: 3.0, ..TsdfConfig::uniform(0.04) }]
}

#[test]
fn sparse_field_is_the_dense_field() {
    let (shots, weights) = holed_shots();
    let views = weighted(&shots, &weights);
    for config in configs() {
        let tsdf = fuse(&views, &config).unwrap();
        let (low, high) = tsdf.bounds().unwrap();
        let dense = brute::dense_field(&views, &config, low, high);
        let (mut compared, mut undecided) = (0, 0);
        for (voxel, value) in voxels_of(&tsdf, low, high) {
            compared += 1;
            let agree = match (value, dense.get(&voxel)) {
                (None, None) => true,
                (Some(value), Some(truth)) => (f64::from(value) - truth).abs() < 2e-3,
                _ => false,
            };
            undecided += usize::from(!agree);
        }
        // Single precision may round to the other pixel, or to the other end of the truncation.
        assert!(compared > 100_000 && undecided < compared / 5_000, "{undecided} of {compared} voxels differ");
    }
}

#[test]
fn no_block_with_surface_is_missing() {
    let (shots, weights) = holed_shots();
    let views = weighted(&shots, &weights);
    for config in configs() {
        let tsdf = fuse(&views, &config).unwrap();
        let (low, high) = tsdf.bounds().unwrap();
        let margin = IVec3::splat(8);
        let dense = brute::dense_field(&views, &config, low - margin, high + margin);
        let truncation = config.truncation / config.voxel;
        let (mut near, mut missing) = (0, 0);
        for (voxel, value) in &dense {
            for axis in IVec3::AXES {
                let Some(other) = dense.get(&(voxel + axis)) else { continue };
                let crossed = (*value < 0.0) != (*other < 0.0) && value.max(*other) < truncation * 0.999;
                if crossed {
                    near += 1;
                    missing += usize::from(tsdf.value(*voxel).is_none() || tsdf.value(voxel + axis).is_none());
                }
            }
        }
        assert!(near > 5_000 && missing == 0, "{missing} of {near} crossings have no block");
    }
}

#[test]
fn shared_vertices_give_the_triangles_of_the_soup() {
    let (shots, weights) = holed_shots();
    let views = weighted(&shots, &weights);
    for config in configs() {
        let tsdf = fuse(&views, &config).unwrap();
        let mesh = tsdf.extract();
        assert_manifold(&mesh);
        assert_no_repeated_vertex(&mesh);
        assert_every_vertex_used(&mesh);
        let bits = |triangle: [[f32; 3]; 3]| triangle.map(|p| p.map(f32::to_bits));
        let mut fast: Vec<_> = (0..mesh.triangles.len()).map(|index| bits(mesh.corners(index))).collect();
        let mut slow: Vec<_> = brute::triangle_soup(&tsdf).into_iter().map(bits).collect();
        fast.sort_unstable();
        slow.sort_unstable();
        assert!(fast.len() > 10_000);
        assert_eq!(fast, slow);
    }
}

#[test]
fn a_view_that_sees_through_a_surface_carves_it_away() {
    let wall = |z: f64| plane(DVec3::Z * z, DVec3::NEG_Z);
    let camera = looking_at(DVec3::ZERO, DVec3::Z, 40, 30, 40.0);
    let shots: Vec<Shot> =
        [2.0, 3.0, 3.0, 3.0].map(|z| Shot::take(camera, &wall(z), &position_colour)).into_iter().collect();
    let mesh = fuse(&views(&shots), &TsdfConfig::uniform(0.05)).unwrap().extract();
    assert!(!mesh.positions.is_empty());
    assert!(mesh.positions.iter().all(|p| (p[2] - 3.0).abs() < 1e-3), "something is left in front of the wall");
}

fn voxels_of(tsdf: &Tsdf<'_>, low: IVec3, high: IVec3) -> Vec<(IVec3, Option<f32>)> {
    let mut voxels = Vec::new();
    for z in low.z..high.z {
        for y in low.y..high.y {
            for x in low.x..high.x {
                let voxel = IVec3::new(x, y, z);
                if tsdf.is_allocated(voxel) {
                    voxels.push((voxel, tsdf.value(voxel)));
                }
            }
        }
    }
    voxels
}

fn assert_every_vertex_used(mesh: &TriMesh) {
    let mut used = vec![false; mesh.positions.len()];
    for vertex in mesh.triangles.iter().flatten() {
        used[*vertex as usize] = true;
    }
    assert!(used.iter().all(|used| *used), "a vertex has no triangle");
    assert!(mesh.normals.len() == used.len() && mesh.colours.len() == used.len());
}
