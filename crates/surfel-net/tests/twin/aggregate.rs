//! Gather attention against gathered tensors in memory, and the aggregation around it.

use super::fixture::{Fixture, out};
use super::nyquist::windows;
use super::{config, device, with_itself};
use crate::aggregate::Aggregation;
use crate::ops::gather_attention;
use crate::ops::gather_attention::Regions;
use std::sync::Arc;

fn regions(fixture: &Fixture) -> Arc<Regions> {
    Arc::new(Regions { width: 6, height: 5, side: 5, targets: with_itself(3), windows: windows(fixture) })
}

#[test]
fn the_gather_attention_equals_gathering_everything() {
    let fixture = Fixture::open("gather_attention");
    let regions = regions(&fixture);
    fixture.assert_function_equal(|| {
        let [query, key, value] = ["query", "key", "value"].map(|name| fixture.input(name));
        vec![out("y", gather_attention(query, key, value, 2, regions.clone()))]
    });
}

#[test]
fn the_aggregation_equals_its_twin() {
    let fixture = Fixture::open("aggregation");
    let regions = regions(&fixture);
    fixture.assert_equal(Aggregation::new(11, &config().aggregation, &device()), |aggregation| {
        vec![out("y", aggregation.forward(fixture.input("features"), regions.clone()))]
    });
}
