//! No term has a unit: a scene measured in another one has the same losses.

use crate::known::{map, picture, value, vectors};
use crate::scene::{HEIGHT, WIDTH, camera, maps, range, surfels, tensors};
use surfel_core::Grid;
use surfel_loss::{Perceptual, Recipe, Truth, depth, opacity, view_terms};

fn losses(unit: f64) -> Vec<(&'static str, f64)> {
    let tensors = tensors(&surfels(unit));
    let rendered = maps(&tensors, unit);
    let tilted = Grid::filled(WIDTH, HEIGHT, [0.6f32, 0.0, -0.8]);
    let measured = map(WIDTH, HEIGHT, |x, y| (unit * (1.8 + 0.01 * x as f64 + 0.02 * y as f64)) as f32);
    let truth = Truth {
        photograph: picture(WIDTH, HEIGHT, 0.0),
        depth: Some(measured.clone()),
        normals: Some((vectors(&tilted), map(WIDTH, HEIGHT, |_, _| 1.0))),
        mask: Some(map(WIDTH, HEIGHT, |x, _| f32::from(u8::from(x > 5)))),
    };
    let setting = (&camera(unit).intrinsics, &range(unit));
    let mut terms = view_terms(&rendered, &truth, setting, &Perceptual::Ssim, &Recipe::default()).expect("equal sizes");
    terms.add("opacity", 1.0, || opacity(tensors.opacities));
    terms.add("expected depth", 1.0, || depth(rendered.depth_expected, measured, &range(unit)));
    terms.list.into_iter().map(|term| (term.name, value(term.value))).collect()
}

#[test]
fn a_thousand_times_larger_scene_has_the_same_losses() {
    for unit in [1000.0, 1e-3] {
        for ((name, small), (_, large)) in losses(1.0).into_iter().zip(losses(unit)) {
            assert!(small > 1e-4, "{name} says nothing: {small}");
            assert!((small - large).abs() < 1e-3 * small, "{name}: {small} in one unit, {large} in another");
        }
    }
}
