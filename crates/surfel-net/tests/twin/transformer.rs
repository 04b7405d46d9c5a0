//! The transformer: one layer with plain windows, one with shifted ones; two and three views.

use super::fixture::{Fixture, out};
use super::{config, device, indices, others};
use crate::transformer::Transformer;

fn assert_equal(name: &'static str, views: usize) {
    let fixture = Fixture::open(name);
    let transformer = Transformer::new(8, &config().transformer.unwrap(), &device());
    fixture.assert_equal(transformer, |transformer| {
        vec![out("y", transformer.forward(fixture.input("features"), indices(&others(views)), None))]
    });
}

#[test]
fn the_transformer_equals_its_twin_on_two_views() {
    assert_equal("transformer_2_views", 2);
}

#[test]
fn the_transformer_equals_its_twin_on_three_views() {
    assert_equal("transformer_3_views", 3);
}
