//! Networks with DINO features, and files of weights that are not what they should be.

use crate::model::{Scene, net, values};
use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::{Device, Gradients, Tensor};
use safetensors::SafeTensors;
use safetensors::tensor::TensorView;
use std::path::{Path, PathBuf};
use surfel_net::config::{DinoConfig, DinoModel, EpipolarConfig};
use surfel_net::{InputError, NetConfig, Preset, SurfelNet, checkpoint};
use surfel_torch::{Dtype, Object};

/// What the PyTorch twin wrote.
fn published(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/twin/fixtures/dino_{name}.safetensors"))
}

/// The tiny network, attending along epipolar lines.
fn plain() -> NetConfig {
    let mut config = NetConfig::preset(Preset::Tiny);
    config.transformer.as_mut().unwrap().epipolar = Some(EpipolarConfig { num_samples: 8, num_heads: 2 });
    config
}

fn with_dino(model: DinoModel, file: Option<PathBuf>) -> NetConfig {
    NetConfig { dino: Some(DinoConfig { model, file }), ..plain() }
}

fn tiny() -> NetConfig {
    with_dino(DinoModel::Tiny, Some(published("original")))
}

/// A copy of a safetensors file with other tensors.
fn edited(from: &Path, to: &Path, edit: impl Fn(&str, Vec<usize>, Vec<u8>) -> Option<(String, Vec<usize>, Vec<u8>)>) {
    let bytes = std::fs::read(from).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let tensors = file.tensors().into_iter().filter_map(|(name, tensor)| {
        let (name, shape, data) = edit(&name, tensor.shape().to_vec(), tensor.data().to_vec())?;
        Some((name, tensor.dtype(), shape, data))
    });
    let tensors: Vec<_> = tensors.collect();
    let views =
        tensors.iter().map(|(name, dtype, shape, data)| (name, TensorView::new(*dtype, shape.clone(), data).unwrap()));
    std::fs::write(to, safetensors::serialize(views, None).unwrap()).unwrap();
}

/// A safetensors file as PyTorch would keep it.
fn write_torch(from: &Path, to: &Path) {
    let bytes = std::fs::read(from).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let tensor = |(name, tensor): (String, TensorView)| {
        let halves = tensor.data().to_vec();
        (name, Object::Tensor(surfel_torch::Tensor::from_bytes(Dtype::F16, tensor.shape().to_vec(), halves)))
    };
    let object = Object::Dict(file.tensors().into_iter().map(tensor).collect());
    surfel_torch::write(&object, std::io::BufWriter::new(std::fs::File::create(to).unwrap())).unwrap();
}

#[test]
fn a_fresh_network_is_the_one_without() {
    let (device, scene) = (Device::flex(), Scene::new(3, 36, 28, 1.0));
    let with = net(tiny(), &device).forward(&scene.input(), &device).unwrap();
    let without = net(plain(), &device).forward(&scene.input(), &device).unwrap();
    assert_eq!(values(&with.maps.depth), values(&without.maps.depth));
    assert_eq!(values(&with.surfels.scales), values(&without.surfels.scales));
}

#[test]
fn epipolar_networks_treat_views_alike_and_know_no_unit() {
    let (device, scene) = (Device::flex(), Scene::new(3, 36, 28, 1.0));
    let net = net(plain(), &device);
    let depth = |scene: &Scene| values(&net.forward(&scene.input(), &device).unwrap().maps.depth);
    let one = depth(&scene);
    let reversed: Vec<f32> =
        depth(&Scene::new(3, 36, 28, 1.0).reversed()).chunks(36 * 28).rev().flatten().copied().collect();
    assert!(one.iter().zip(&reversed).all(|(a, b)| (a - b).abs() < 1e-3 * a));
    let large = depth(&Scene::new(3, 36, 28, 1000.0));
    assert!(one.iter().zip(&large).all(|(a, b)| (1000.0 * a - b).abs() < 1e-3 * b));
}

#[test]
fn weights_files_hold_the_fusion_but_neither_dino_nor_its_path() {
    let (device, scene, folder) = (Device::flex(), Scene::new(2, 32, 32, 1.0), tempfile::tempdir().unwrap());
    let [fresh, trained] = ["fresh", "trained"].map(|name| folder.path().join(name));
    let depth = |net: &SurfelNet| values(&net.forward(&scene.input(), &device).unwrap().maps.depth);
    let net = net(tiny(), &device);
    checkpoint::save(&net, &fresh).unwrap();
    edited(&fresh, &trained, |name, shape, data| {
        assert!(!name.starts_with("dino."), "{name}");
        let data = if name == "dino_fusion.join.weight" {
            data.chunks(4).enumerate().flat_map(|(i, _)| (0.1 * (i as f32).sin()).to_le_bytes()).collect()
        } else {
            data
        };
        Some((name.to_owned(), shape, data))
    });
    // Features matter once the last layer has left zero.
    let before = depth(&net);
    let net = checkpoint::load(net, &trained).unwrap();
    let after = depth(&net);
    assert!(before.iter().zip(&after).any(|(a, b)| (a - b).abs() > 1e-3));
    // The file of one machine is read on another: DINO's is named again.
    checkpoint::save(&net, &trained).unwrap();
    let text = String::from_utf8_lossy(&std::fs::read(&trained).unwrap()).into_owned();
    assert!(text.contains("model = \\\"tiny\\\"") && !text.contains("dino_original"));
    let read = SurfelNet::from_file(&trained, &device).unwrap();
    let error = read.forward(&scene.input(), &device).unwrap_err();
    assert_eq!(error, InputError::NoDino { model: DinoModel::Tiny });
    assert!(error.to_string().contains("name their file with `--dino`"), "{error}");
    let original = folder.path().join("dino.pth");
    write_torch(&published("original"), &original);
    for file in [published("original"), published("hugging_face"), original] {
        assert_eq!(depth(&read.clone().with_dino(file, &device).unwrap()), after);
    }
    let error = SurfelNet::new(plain(), &device).unwrap().with_dino(published("original"), &device).unwrap_err();
    assert!(error.to_string().ends_with("this network adds no DINO features"), "{error}");
}

/// Names of parameters whose gradient is not zero.
struct Moving<'a> {
    grads: &'a Gradients,
    path: Vec<String>,
    found: Vec<String>,
}

impl ModuleVisitor for Moving<'_> {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let grad = param.val().grad(self.grads).unwrap_or_else(|| panic!("{} has no gradient", self.path.join(".")));
        if values(&grad).iter().any(|v| *v != 0.0) {
            self.found.push(self.path.join("."));
        }
    }
}

#[test]
fn gradients_reach_the_fusion_and_the_attention_along_lines_but_not_dino() {
    let device = Device::flex().autodiff();
    let (net, scene) = (net(tiny(), &device), Scene::new(2, 32, 32, 1.0));
    let prediction = net.forward(&scene.input(), &device).unwrap();
    let grads = (prediction.maps.depth.sum() + prediction.surfels.sh.sin().sum()).backward();
    let mut moving = Moving { grads: &grads, path: Vec::new(), found: Vec::new() };
    net.visit(&mut moving);
    for name in ["dino_fusion.join.weight", "dino_fusion.join.bias"] {
        assert!(moving.found.iter().any(|found| found == name), "{name}");
    }
    for part in ["query", "key", "value", "depth_key", "depth_value", "merge"] {
        let name = format!("transformer.layers.0.along.{part}.weight");
        assert!(moving.found.contains(&name), "{name} not in {:?}", moving.found);
    }
    let names = net.parts();
    assert_eq!(names.last(), Some(&("DINO fusion", 16 * 16 + 16 + 9 * 16 * 16 + 16)));
}

#[test]
fn other_files_are_refused_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dino.safetensors");
    let refusal = |config: NetConfig| SurfelNet::new(config, &Device::flex()).unwrap_err().to_string();
    let of_file = || refusal(with_dino(DinoModel::Tiny, Some(path.clone())));
    type Edit = fn(&str, Vec<usize>, Vec<u8>) -> Option<(String, Vec<usize>, Vec<u8>)>;
    let cases: [(&str, Edit, &str); 5] = [
        (
            "original",
            |name, shape, data| (name != "blocks.1.attn.qkv.bias").then(|| (name.to_owned(), shape, data)),
            "has no tensor named blocks.1.attn.qkv.bias",
        ),
        (
            "hugging_face",
            |name, shape, data| {
                (name != "encoder.layer.1.attention.attention.key.bias").then(|| (name.to_owned(), shape, data))
            },
            "has no tensor named encoder.layer.1.attention.attention.key.bias",
        ),
        (
            "original",
            |name, shape, data| Some((name.replace("mask_token", "blocks.2.norm1.bias"), shape, data)),
            "holds blocks.2.norm1.bias, which the tiny DINOv2 of tests does not have",
        ),
        (
            "original",
            |name, shape, data| Some((name.replace("mask_token", "register_tokens"), shape, data)),
            "has register tokens",
        ),
        (
            "original",
            |name, shape, data| {
                let shape = if name == "pos_embed" { vec![1, 16, 10] } else { shape };
                Some((name.to_owned(), shape, data))
            },
            "tensor pos_embed in",
        ),
    ];
    for (name, edit, expected) in cases {
        edited(&published(name), &path, edit);
        let error = of_file();
        assert!(error.contains(expected), "{error}");
    }
    let error = of_file();
    assert!(error.contains("has shape [1, 16, 10] where the network needs [1, 10, 16]"), "{error}");
    let error = refusal(with_dino(DinoModel::VitS14, Some(published("original"))));
    assert!(error.contains("cls_token") && error.contains("needs [1, 1, 384]"), "{error}");
    std::fs::write(&path, b"no weights at all").unwrap();
    let error = of_file();
    assert!(error.contains("dino.safetensors"), "{error}");
    let error = refusal(with_dino(DinoModel::Tiny, Some(folder.path().join("none"))));
    assert!(error.contains("cannot be read"), "{error}");
}

#[test]
fn settings_name_models_as_published() {
    let text = include_str!("../../presets/tiny.toml");
    let config = |more: &str| NetConfig::from_toml(&format!("{text}\n{more}"));
    let found = config("[dino]\nmodel = \"vit_l14\"\nfile = \"some/where.safetensors\"").unwrap().dino.unwrap();
    assert_eq!(found, DinoConfig { model: DinoModel::VitL14, file: Some("some/where.safetensors".into()) });
    assert_eq!((DinoModel::VitS14.width(), DinoModel::VitL14.width()), (384, 1024));
    assert!(config("[dino]\nmodel = \"vit_g14\"").is_err());
    for (settings, key) in [
        ("{ num_samples = 1, num_heads = 2 }", "transformer.epipolar.num_samples"),
        ("{ num_samples = 8, num_heads = 3 }", "transformer.epipolar.num_heads"),
    ] {
        let text = text.replacen("num_splits = 2", &format!("num_splits = 2\nepipolar = {settings}"), 1);
        let error = NetConfig::from_toml(&text).unwrap_err().to_string();
        assert!(error.contains(key) && error.contains("it must be"), "{error}");
    }
}
