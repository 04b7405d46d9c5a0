//! The whole `tiny` graph on three views whose size must be padded.

use super::device;
use super::fixture::{Fixture, out};
use super::head::surfel_outputs;
use crate::{DepthRange, NetConfig, Preset, SceneInput, SurfelNet};
use surfel_core::Grid;

const WIDTH: usize = 28;
const HEIGHT: usize = 20;

#[test]
fn the_tiny_network_equals_its_twin() {
    let fixture = Fixture::open("network");
    let channels = fixture.values("given.images");
    let images: Vec<Grid<[f32; 3]>> = channels
        .chunks_exact(3 * WIDTH * HEIGHT)
        .map(|image| Grid::from_fn(WIDTH, HEIGHT, |x, y| [0, 1, 2].map(|c| image[(c * HEIGHT + y) * WIDTH + x])))
        .collect();
    let cameras = fixture.cameras(WIDTH, HEIGHT);
    let ranges = [(1.5, 6.0), (1.4, 5.0), (1.6, 7.0)].map(|(near, far)| DepthRange { near, far });
    let scene = SceneInput { images: &images, cameras: &cameras, ranges: &ranges };
    let net = SurfelNet::new(NetConfig::preset(Preset::Tiny), &device()).unwrap();
    fixture.assert_equal(net, |net| {
        let prediction = net.forward(&scene, &device()).unwrap();
        let mut outputs = surfel_outputs(prediction.surfels);
        outputs.extend([
            out("initial_scales", prediction.initial.scales),
            out("initial_rotations", prediction.initial.rotations),
            out("depth", prediction.depth),
            out("confidence", prediction.confidence),
        ]);
        outputs
    });
}
