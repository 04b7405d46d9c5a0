//! The attribute head and the adapter.

use super::fixture::{Fixture, Outputs, out};
use super::{config, device};
use crate::SurfelTensors;
use crate::config::HeadConfig;
use crate::head::{Adapter, AttributeHead};

/// All parts of surfels.
pub(super) fn surfel_outputs(surfels: SurfelTensors) -> Outputs {
    vec![
        out("centres", surfels.centres),
        out("scales", surfels.scales),
        out("rotations", surfels.rotations),
        out("opacities", surfels.opacities),
        out("sh", surfels.sh),
    ]
}

#[test]
fn the_attribute_head_equals_its_twin() {
    let fixture = Fixture::open("attributes");
    let head = AttributeHead::new(10, &config().head, false, &device());
    fixture.assert_equal(head, |head| vec![out("y", head.forward(fixture.input("features")))]);
}

#[test]
fn the_adapter_equals_its_twin() {
    let fixture = Fixture::open("adapter");
    let config = HeadConfig { sh_degree: 3, scale_min: 0.5, scale_max: 15.0, hidden_channels: None };
    let adapter = Adapter::new(&fixture.cameras(6, 5), &config, &device());
    fixture.assert_function_equal(|| {
        let [attributes, depth, opacity] = ["attributes", "depth", "opacity"].map(|name| fixture.input(name));
        surfel_outputs(adapter.forward(attributes, depth, opacity, None))
    });
}
