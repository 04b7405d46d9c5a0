//! Nothing depends on the unit, the origin or the axes of the world: "scale a scene by 1000 and the mesh scales by
//! 1000".

use crate::command::{SIZE, reconstruct};
use crate::read_back::{bounds, vertices};
use crate::scene_files::{height_field, write_cameras, write_scene};
use glam::{DMat3, DQuat, DVec3};
use std::path::{Path, PathBuf};
use surfel_core::{Rigid, Similarity};
use surfel_io::depth::read_pfm;

/// `new_from_old` worlds in which the same photographs are reconstructed.
fn moves() -> Vec<(&'static str, Similarity)> {
    let still = Similarity { scale: 1.0, rotation: DMat3::IDENTITY, translation: DVec3::ZERO };
    let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 1.1, -0.4, 2.3));
    vec![
        ("a thousand times as large", Similarity { scale: 1000.0, ..still }),
        ("a thousandth", Similarity { scale: 1e-3, ..still }),
        ("turned and far away", Similarity { rotation: turn, translation: DVec3::new(5e3, -2e3, 8e3), ..still }),
    ]
}

fn reconstruction(folder: &Path, new_from_old: &Similarity) -> PathBuf {
    let (scene, out) = (folder.join("scene"), folder.join("out"));
    let views = &height_field()[..2];
    write_scene(&scene, views);
    write_cameras(&scene, views, |camera| camera.in_frame(new_from_old));
    reconstruct(&scene, &out, &["--size", SIZE]).succeeded("reconstruct");
    out
}

#[test]
fn the_mesh_moves_and_scales_with_the_world() {
    let folder = tempfile::tempdir().unwrap();
    let still = Similarity { scale: 1.0, rotation: Rigid::IDENTITY.rotation, translation: DVec3::ZERO };
    let original = reconstruction(folder.path(), &still);
    let old = vertices(&original.join("mesh.ply"));
    for (what, new_from_old) in moves() {
        let folder = tempfile::tempdir().unwrap();
        let out = reconstruction(folder.path(), &new_from_old);
        let expected: Vec<DVec3> = old.iter().map(|p| new_from_old.transform(*p)).collect();
        let found = vertices(&out.join("mesh.ply"));
        let ratio = found.len() as f64 / expected.len() as f64;
        assert!((ratio - 1.0).abs() < 0.01, "{what}: {} vertices for {}", found.len(), expected.len());
        let [[low, high], [expected_low, expected_high]] = [bounds(&found), bounds(&expected)];
        let diagonal = expected_low.distance(expected_high);
        assert!(low.distance(expected_low).max(high.distance(expected_high)) < 1e-3 * diagonal, "{what}: bounding box");
        for (from, to) in [(&found, &expected), (&expected, &found)] {
            let far = mean_distance(from, to) / diagonal;
            assert!(far < 1e-4, "{what}: vertices lie {far} diagonals apart");
        }
        assert_same_depths(what, &original, &out, new_from_old.scale as f32);
    }
}

fn assert_same_depths(what: &str, original: &Path, out: &Path, scale: f32) {
    for stem in ["00", "01"] {
        let [old, new] = [original, out].map(|out| read_pfm(&out.join(format!("depth/{stem}.pfm"))).unwrap());
        let same = |(old, new): &(&f32, &f32)| (*new / scale - *old).abs() <= 1e-3 * *old;
        let num_same = old.as_slice().iter().zip(new.as_slice()).filter(same).count();
        assert!(num_same as f64 >= 0.99 * old.len() as f64, "{what}: {num_same} of {} depths of {stem}", old.len());
    }
}

/// Mean distance to the nearest of `to`, over a hundredth of `from`.
fn mean_distance(from: &[DVec3], to: &[DVec3]) -> f64 {
    let nearest = |p: &DVec3| to.iter().map(|q| p.distance_squared(*q)).fold(f64::INFINITY, f64::min).sqrt();
    let sample: Vec<f64> = from.iter().step_by(100).map(nearest).collect();
    sample.iter().sum::<f64>() / sample.len() as f64
}
