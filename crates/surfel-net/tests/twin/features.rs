//! The CNN backbone, and the pyramid over the trunk's maps.

use super::fixture::{Fixture, out};
use super::{config, device};
use crate::config::BackboneConfig;
use crate::features::cnn::Cnn;
use crate::features::pyramid::Pyramid;

#[test]
fn the_cnn_equals_its_twin() {
    let fixture = Fixture::open("cnn");
    let BackboneConfig::Cnn { channels, widths } = config().backbone else { panic!("twin.toml has no CNN") };
    let cnn = Cnn::new(widths, channels, &device());
    fixture.assert_equal(cnn, |cnn| vec![out("y", cnn.forward(fixture.input("images")))]);
}

#[test]
fn the_pyramid_equals_its_twin() {
    let fixture = Fixture::open("pyramid");
    fixture.assert_equal(Pyramid::new(8, &device()), |pyramid| {
        vec![out("y", pyramid.merged(["s4", "s8", "s16"].map(|name| fixture.input(name))))]
    });
}
