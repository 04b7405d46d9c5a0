//! The fast path against the slow obvious twin on random scenes, and the assertion that compares them.

mod support;

use support::{Tolerance, camera, compare, map_grads, surfels};
use surfel_raster::twin::{self, TwinSurfels};
use surfel_raster::{BoundingBox, RenderConfig, SurfelSlices, backward, forward, render};

const TOLERANCE: Tolerance = Tolerance { value: 2e-5, margin: 1e-4, border_share: 0.5 };

fn configs() -> Vec<(&'static str, RenderConfig)> {
    let plain = RenderConfig { background: [0.1, 0.5, 0.9], ..RenderConfig::default() };
    vec![
        ("default", plain),
        ("reference box", RenderConfig { bounding_box: BoundingBox::Reference, ..plain }),
        ("centre depth", RenderConfig { centre_depth_when_lowpass: true, ..plain }),
        ("reference gradients", RenderConfig { reference_grad: true, ..plain }),
        ("near clip inside the scene", RenderConfig { near_clip: 1.7, dist_near: 1.0, dist_far: 5.0, ..plain }),
    ]
}

#[test]
fn maps_agree() {
    for (name, config) in configs() {
        for (seed, (width, height, count)) in
            [(70, 45, 400), (33, 17, 1500), (16, 16, 40), (1, 1, 30)].into_iter().enumerate()
        {
            let camera = camera(width, height);
            let surfels = surfels(&camera, count, seed % 4, seed as u64);
            let slices = SurfelSlices::from(&surfels);
            let maps = render(&slices, &camera, &config).expect("a sound scene");
            let slow = twin::render(&TwinSurfels::from(&slices), &camera, &config).expect("a sound scene");
            match compare(&maps, &slow, TOLERANCE) {
                Ok(difference) => eprintln!("{name}, {width}x{height}: {difference:?}"),
                Err(complaint) => panic!("{name}, {width}x{height}: {complaint}"),
            }
        }
    }
}

#[test]
fn gradients_agree() {
    for (name, config) in configs() {
        let camera = camera(40, 26);
        let surfels = surfels(&camera, 150, 3, 11);
        let slices = SurfelSlices::from(&surfels);
        let grads = map_grads(camera.width, camera.height, 5);
        let (_, tape) = forward(&slices, &camera, &config).expect("a sound scene");
        let fast = backward(&slices, &tape, &grads).expect("a sound scene");
        let slow = twin::backward(&TwinSurfels::from(&slices), &camera, &config, &grads).expect("a sound scene");
        let mut off = Vec::new();
        for k in 0..surfels.len() {
            let n = surfels.num_coefficients();
            let shape = &slow.shapes[k];
            let kinds: [(&str, &[f32], &[f64]); 5] = [
                ("centre", &fast.centres[k], &shape.centre.to_array()),
                ("scales", &fast.scales[k], &shape.scales.to_array()),
                ("rotation", &fast.rotations[k], &shape.rotation),
                ("opacity", &[fast.opacities[k]], &[shape.opacity]),
                ("sh", fast.sh[k * n..][..n].as_flattened(), slow.sh[k].as_flattened()),
            ];
            for (kind, fast, slow) in kinds {
                let largest = slow.iter().fold(1e-3f64, |m, g| m.max(g.abs()));
                let error = fast.iter().zip(slow).fold(0.0f64, |m, (f, s)| m.max((f64::from(*f) - s).abs())) / largest;
                if error.is_nan() || error > 1e-3 {
                    off.push(format!("{kind} of {k}: {error:.1e}"));
                }
            }
        }
        // Rounding may tip a decision at a few pixels, and each touches the surfels blended there.
        assert!(off.len() <= 3, "{name}: {off:?}");
        eprintln!("{name}: beyond 1e-3: {off:?}");
    }
}

#[test]
fn the_comparison_sees_an_interior_change_and_counts_border_ones() {
    let camera = camera(24, 24);
    let surfels = surfels(&camera, 60, 0, 3);
    let slices = SurfelSlices::from(&surfels);
    let config = RenderConfig::default();
    let maps = render(&slices, &camera, &config).expect("a sound scene");
    let slow = twin::render(&TwinSurfels::from(&slices), &camera, &config).expect("a sound scene");
    assert!(compare(&maps, &slow, TOLERANCE).is_ok());

    let on_border =
        |margin: f64| slow.as_slice().iter().position(|p| (p.margin < TOLERANCE.margin) == (margin < TOLERANCE.margin));
    let interior = on_border(1.0).expect("most pixels are interior");
    let mut wrong = maps.clone();
    wrong.alpha.as_mut_slice()[interior] += 1e-3;
    assert!(compare(&wrong, &slow, TOLERANCE).is_err(), "an interior difference must be seen");
    wrong.alpha.as_mut_slice()[interior] = f32::NAN;
    assert!(compare(&wrong, &slow, TOLERANCE).is_err(), "a NaN must be seen");

    let mut all_border = slow.clone();
    all_border.as_mut_slice().iter_mut().for_each(|p| p.margin = 0.0);
    let mut wrong = maps.clone();
    wrong.alpha.as_mut_slice()[interior] += 1e-3;
    assert!(compare(&wrong, &all_border, TOLERANCE).is_ok(), "one tipped border pixel is allowed");
    wrong.alpha.as_mut_slice().iter_mut().for_each(|a| *a += 1e-3);
    assert!(compare(&wrong, &all_border, TOLERANCE).is_err(), "a border that is wrong all over is not");
}
