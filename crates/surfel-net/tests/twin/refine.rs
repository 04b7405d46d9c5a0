//! The refinement with its feature upsampler and its second sweep.

use super::fixture::{Fixture, out};
use super::{config, device, indices, others, with_itself};
use crate::DepthRange;
use crate::depth::{Refinement, SceneGeometry};

#[test]
fn the_refinement_equals_its_twin() {
    let fixture = Fixture::open("refine");
    let (config, neighbours, sources) = (config(), others(2), indices(&with_itself(2)));
    let ranges = [DepthRange { near: 1.5, far: 6.0 }, DepthRange { near: 1.4, far: 5.0 }];
    let cameras = fixture.cameras(16, 8);
    let scene = SceneGeometry { cameras: &cameras, neighbours: &neighbours, ranges: &ranges, sources: &sources };
    fixture.assert_equal(Refinement::new(&config, &device()), |refinement| {
        let [images, matching, context, coarse, confidence] =
            ["images", "matching", "context", "coarse", "confidence"].map(|name| fixture.input(name));
        let refined = refinement.forward(&config, images, (matching, context), (coarse, confidence), &scene);
        vec![
            out("disparity", refined.disparity),
            out("density", refined.density),
            out("features", refined.features.at_every_pixel()),
        ]
    });
}
