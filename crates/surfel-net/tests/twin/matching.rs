//! The plane sweep against grid sampling, and the coarse depth.

use super::fixture::{Fixture, out};
use super::{config, device, indices, others, with_itself};
use crate::DepthRange;
use crate::cost_volume::{sweep, uniform_candidates, warps};
use crate::depth::CoarseDepth;
use crate::ops::plane_sweep;
use crate::ops::plane_sweep::{Base, Sweep};
use std::sync::Arc;

#[test]
fn the_plane_sweep_equals_grid_sampling() {
    let fixture = Fixture::open("sweep");
    let warps = warps(&fixture.cameras(40, 32), &others(3), 4);
    let candidates = vec![uniform_candidates(&DepthRange { near: 1.2, far: 6.0 }, 8); 3];
    let coarse = Arc::new(sweep(warps.clone(), (10, 8), candidates, Base::Zero));
    let base = fixture.values("given.base");
    let fine = Arc::new(sweep(warps, (10, 8), vec![vec![-0.1, 0.0, 0.1]; 3], Base::PerPixel(base)));
    fixture.assert_function_equal(|| {
        let volume = |geometry: &Arc<Sweep>| plane_sweep(fixture.input("features"), geometry.clone());
        vec![out("coarse", volume(&coarse)), out("fine", volume(&fine))]
    });
}

#[test]
fn the_coarse_depth_equals_its_twin() {
    let fixture = Fixture::open("coarse");
    let coarse = CoarseDepth::new(8, &config().cost_volume.unwrap(), &device());
    fixture.assert_equal(coarse, |coarse| {
        let sources = indices(&with_itself(2));
        let (disparity, confidence) = coarse.forward(fixture.input("correlation"), fixture.input("features"), &sources);
        vec![out("disparity", disparity), out("confidence", confidence)]
    });
}
