//! DINO features: the transformer, published files of both kinds, and the fusion.

use super::device;
use super::fixture::{Fixture, out};
use crate::features::dino::{Dino, DinoFusion, DinoModel, Vit};
use burn::tensor::{Tensor, TensorData};

#[test]
fn the_vision_transformer_equals_its_twin() {
    let fixture = Fixture::open("vit");
    fixture.assert_equal(Vit::new(DinoModel::Tiny, &device()), |vit| {
        ["wide", "square"].map(|name| out(name, vit.forward(fixture.input(name)))).to_vec()
    });
}

#[test]
fn features_of_published_files_equal_their_twin() {
    let fixture = Fixture::open("dino_patches");
    let images = TensorData::new(fixture.values("given.images"), [2, 3, 16, 32]);
    for name in ["dino_original", "dino_hugging_face"] {
        let path = Fixture::path(name);
        let dino = Dino::from_file(DinoModel::Tiny, &path, &device()).unwrap();
        let patches = dino.patches(Tensor::from_data(images.clone(), dino.device()));
        fixture.assert_outputs_equal(&vec![out("y", patches)]);
    }
}

#[test]
fn the_fusion_equals_its_twin() {
    let fixture = Fixture::open("dino_fusion");
    fixture.assert_equal(DinoFusion::new(16, 8, &device()), |fusion| {
        vec![out("y", fusion.forward(fixture.input("context"), fixture.input("patches")))]
    });
}
