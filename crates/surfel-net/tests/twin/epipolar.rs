//! Attention along epipolar lines: the operator, and the transformer with it.

use super::fixture::{Fixture, out};
use super::{config, device, indices, others, with_itself};
use crate::DepthRange;
use crate::config::EpipolarConfig;
use crate::depth::SceneGeometry;
use crate::ops::epipolar::EpipolarLines;
use crate::ops::epipolar_attention;
use crate::transformer::Transformer;
use std::sync::Arc;

const RANGES: [DepthRange; 3] =
    [DepthRange { near: 1.5, far: 6.0 }, DepthRange { near: 1.4, far: 5.0 }, DepthRange { near: 1.6, far: 7.0 }];

fn transformer(num_samples: usize) -> Transformer {
    let mut config = config().transformer.unwrap();
    config.epipolar = Some(EpipolarConfig { num_samples, num_heads: 2 });
    Transformer::new(8, &config, &device())
}

fn lines(fixture: &Fixture, num_samples: usize, (width, height): (usize, usize)) -> Arc<EpipolarLines> {
    let cameras = fixture.cameras(4 * width, 4 * height);
    let (neighbours, sources) = (others(3), indices(&with_itself(3)));
    let geometry = SceneGeometry { cameras: &cameras, neighbours: &neighbours, ranges: &RANGES, sources: &sources };
    transformer(num_samples).lines(&geometry, (width, height)).unwrap()
}

#[test]
fn attention_along_lines_equals_gathering_every_sample() {
    let fixture = Fixture::open("epipolar_attention");
    let lines = lines(&fixture, 5, (8, 6));
    fixture.assert_function_equal(|| {
        let maps = ["key", "value"].map(|name| fixture.input(name));
        let depths = ["depth_key", "depth_value"].map(|name| fixture.input(name));
        vec![out("y", epipolar_attention(fixture.input("query"), maps, depths, 2, lines.clone()))]
    });
}

#[test]
fn the_epipolar_transformer_equals_its_twin() {
    let fixture = Fixture::open("transformer_epipolar");
    let lines = lines(&fixture, 7, (12, 8));
    fixture.assert_equal(transformer(7), |transformer| {
        let features = fixture.input("features");
        vec![out("y", transformer.forward(features, indices(&others(3)), Some(lines.clone())))]
    });
}
