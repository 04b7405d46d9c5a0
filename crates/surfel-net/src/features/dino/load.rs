//! Published DINOv2 files to a [`Vit`]: the names of the original release, and those of Hugging Face.
//!
//! Safetensors or PyTorch, one tensor in memory at a time, so that a file of a gigabyte costs no more than its
//! weights. Invariant: a file is taken whole or refused in a sentence; what it holds beyond the model is a fault, too.

use super::vit::Vit;
use super::{DinoModel, PATCH};
use crate::checkpoint::tree::replace_under;
use crate::import::{ImportError, Source};
use burn::tensor::Device;
use std::collections::BTreeSet;
use std::path::Path;
use surfel_features::WeightsError;

/// Whose names a file uses.
#[derive(Clone, Copy, PartialEq)]
enum Names {
    Original,
    HuggingFace,
}

/// The tensors of a file that together are one of ours.
struct Origin {
    /// One, or query, key and value to be stacked.
    names: Vec<String>,
    /// Shape of each in the file.
    shape: Vec<usize>,
    /// Theirs is outputs x inputs where ours is inputs x outputs.
    transposed: bool,
}

/// The model with the weights of a file.
///
/// # Errors
/// [`WeightsError`] when the file cannot be read, is damaged, or holds another model.
pub(super) fn load(model: DinoModel, path: &Path, device: &Device) -> Result<Vit, WeightsError> {
    let file = path.display().to_string();
    let unusable = |reason: String| WeightsError::Unusable { file: file.clone(), reason };
    let reading = |error| match error {
        ImportError::Weights(error) => error,
        other => unusable(other.to_string()),
    };
    let mut source = Source::open(path).map_err(reading)?;
    let names = if source.shape("embeddings.cls_token").is_some() { Names::HuggingFace } else { Names::Original };
    if source.names().any(|name| name.contains("register_tokens")) {
        return Err(unusable(format!("it has register tokens; take the file of {model} without them")));
    }
    // A token that only pretraining uses.
    let mut left: BTreeSet<String> =
        source.names().filter(|name| !name.ends_with("mask_token")).map(str::to_owned).collect();
    let mut fault = None;
    let vit = replace_under(Vit::new(model, device), &[], |name, shape| {
        let origin = origin(name, shape, names);
        left.retain(|name| !origin.names.contains(name));
        match read(&mut source, &file, &origin) {
            Ok(values) if origin.transposed => Some(transposed(&values, shape)),
            Ok(values) => Some(values),
            Err(error) => {
                fault.get_or_insert(reading(error));
                None
            }
        }
    });
    match (fault, left.first()) {
        (Some(fault), _) => Err(fault),
        (None, Some(tensor)) => {
            Err(unusable(format!("it holds {tensor}, which {model} does not have; it belongs to another network")))
        }
        (None, None) => Ok(vit),
    }
}

fn read(source: &mut Source, file: &str, origin: &Origin) -> Result<Vec<f32>, ImportError> {
    let mut values = Vec::new();
    for name in &origin.names {
        if let Some(found) = source.shape(name).filter(|shape| *shape != origin.shape) {
            let (file, tensor) = (file.to_owned(), name.clone());
            let (found, expected) = (found.to_vec(), origin.shape.clone());
            return Err(WeightsError::WrongShape { file, tensor, found, expected }.into());
        }
        values.extend(source.values(name)?);
    }
    Ok(values)
}

/// `[outputs, inputs]` to `[inputs, outputs]`, where `shape` is the latter.
fn transposed(values: &[f32], shape: &[usize]) -> Vec<f32> {
    let (inputs, outputs) = (shape[0], shape[1]);
    (0..inputs * outputs).map(|i| values[i % outputs * inputs + i / outputs]).collect()
}

/// Where our parameter `name` of this shape comes from.
fn origin(name: &str, shape: &[usize], names: Names) -> Origin {
    let one = |original: String, hugging_face: String, shape: Vec<usize>, transposed: bool| {
        let name = if names == Names::Original { original } else { hugging_face };
        Origin { names: vec![name], shape, transposed }
    };
    let path: Vec<&str> = name.split('.').collect();
    let embeddings = |original: &str, hugging_face: &str, shape: Vec<usize>, transposed: bool| {
        one(original.to_owned(), format!("embeddings.{hugging_face}"), shape, transposed)
    };
    match path.as_slice() {
        ["class_token"] => embeddings("cls_token", "cls_token", vec![1, 1, shape[0]], false),
        ["positions"] => embeddings("pos_embed", "position_embeddings", [&[1], shape].concat(), false),
        ["patches", "weight"] => embeddings(
            "patch_embed.proj.weight",
            "patch_embeddings.projection.weight",
            vec![shape[1], 3, PATCH, PATCH],
            true,
        ),
        ["patches", kind] => embeddings(
            &format!("patch_embed.proj.{kind}"),
            &format!("patch_embeddings.projection.{kind}"),
            shape.to_vec(),
            false,
        ),
        ["norm", kind] => {
            let kind = torch(kind);
            one(format!("norm.{kind}"), format!("layernorm.{kind}"), shape.to_vec(), false)
        }
        ["blocks", i, "qkv", kind] if names == Names::HuggingFace => {
            let part = |part| format!("encoder.layer.{i}.attention.attention.{part}.{kind}");
            let mut shape: Vec<usize> = shape.iter().rev().copied().collect();
            shape[0] /= 3;
            Origin { names: ["query", "key", "value"].map(part).to_vec(), shape, transposed: *kind == "weight" }
        }
        ["blocks", i, rest @ ..] => {
            let (original, hugging_face) = layer(rest);
            let transposed = shape.len() == 2;
            let shape = shape.iter().rev().copied().collect();
            one(format!("blocks.{i}.{original}"), format!("encoder.layer.{i}.{hugging_face}"), shape, transposed)
        }
        _ => unreachable!("every parameter of the transformer is named above"),
    }
}

/// A parameter of a block in both languages.
fn layer(path: &[&str]) -> (String, String) {
    let kind = path.get(1).map_or("", |kind| torch(kind));
    let same = |name: &str| (format!("{name}.{kind}"), format!("{name}.{kind}"));
    match path[0] {
        "attention_norm" => same("norm1"),
        "qkv" => same("attn.qkv"),
        "merge" => (format!("attn.proj.{kind}"), format!("attention.output.dense.{kind}")),
        "attention_gamma" => ("ls1.gamma".to_owned(), "layer_scale1.lambda1".to_owned()),
        "feed_norm" => same("norm2"),
        "widen" => same("mlp.fc1"),
        "narrow" => same("mlp.fc2"),
        "feed_gamma" => ("ls2.gamma".to_owned(), "layer_scale2.lambda1".to_owned()),
        other => unreachable!("a block has no part {other}"),
    }
}

/// PyTorch's word for a kind of parameter.
fn torch(kind: &str) -> &str {
    match kind {
        "gamma" => "weight",
        "beta" => "bias",
        other => other,
    }
}
