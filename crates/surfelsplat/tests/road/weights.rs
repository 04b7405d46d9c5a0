//! `weights info`, `verify` and `import`: made-up checkpoints in, our own files out.

use crate::command::{Run, surfelsplat};
use std::fs::File;
use std::path::Path;
use surfel_torch::{Object, Tensor};

/// Backbone and transformer of preset tiny under their UniMatch names (spec 2.12), every value `0.25`.
fn unimatch(path: &Path, without: Option<&str>) {
    let c = 16;
    let mut tensors = Vec::new();
    let mut push = |name: String, shape: &[usize]| {
        let values = vec![0.25; shape.iter().product()];
        tensors.push((name, Object::Tensor(Tensor::from_f32(shape.to_vec(), &values))));
    };
    push("backbone.conv1.weight".to_owned(), &[8, 3, 7, 7]);
    for (layer, inputs, outputs) in [(1, 8, 8), (2, 8, 8), (3, 8, c)] {
        for (block, inputs) in [(0, inputs), (1, outputs)] {
            push(format!("backbone.layer{layer}.{block}.conv1.weight"), &[outputs, inputs, 3, 3]);
            push(format!("backbone.layer{layer}.{block}.conv2.weight"), &[outputs, outputs, 3, 3]);
        }
        if layer > 1 {
            push(format!("backbone.layer{layer}.0.downsample.0.weight"), &[outputs, inputs, 1, 1]);
            push(format!("backbone.layer{layer}.0.downsample.0.bias"), &[outputs]);
        }
    }
    push("backbone.conv2.weight".to_owned(), &[c, c, 1, 1]);
    push("backbone.conv2.bias".to_owned(), &[c]);
    for i in 0..2 {
        for (part, norms) in [("self_attn", 1), ("cross_attn_ffn", 2)] {
            let part = format!("transformer.layers.{i}.{part}");
            ["q_proj", "k_proj", "v_proj", "merge"].iter().for_each(|p| push(format!("{part}.{p}.weight"), &[c, c]));
            for norm in 1..=norms {
                ["weight", "bias"].iter().for_each(|p| push(format!("{part}.norm{norm}.{p}"), &[c]));
            }
        }
        push(format!("transformer.layers.{i}.cross_attn_ffn.mlp.0.weight"), &[2 * c * HIDDEN, 2 * c]);
        push(format!("transformer.layers.{i}.cross_attn_ffn.mlp.2.weight"), &[c, 2 * c * HIDDEN]);
    }
    push("feature_flow_attn.q_proj.weight".to_owned(), &[2, 2]);
    tensors.retain(|(name, _)| Some(name.as_str()) != without);
    let object = Object::Dict(vec![("model".to_owned(), Object::Dict(tensors))]);
    surfel_torch::write(&object, File::create(path).unwrap()).unwrap();
}

/// `transformer.expansion` of preset tiny.
const HIDDEN: usize = 1;

fn weights(command: &str, file: &Path, more: &[&str]) -> Run {
    let args = ["weights".as_ref(), command.as_ref(), file.as_os_str()];
    surfelsplat(args.into_iter().chain(more.iter().map(|arg| arg.as_ref())))
}

#[test]
fn an_imported_file_describes_and_proves_itself() {
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("gmdepth.pth"), folder.path().join("net.safetensors"));
    unimatch(&source, None);
    let output = out.to_str().unwrap();
    let fixed = ["--preset", "tiny", "--licence", "MIT", "--precision", "f16", "-o", output];
    let run = weights("import", &source, &fixed).succeeded("import");
    assert!(run.stdout.contains("from gmdepth.pth (UniMatch)"), "{}", run.stdout);
    assert!(run.stdout.contains("transformer: 32 of 32"), "{}", run.stdout);
    assert!(run.stdout.contains("left: 1 tensors, such as feature_flow_attn.q_proj.weight"), "{}", run.stdout);

    let first = std::fs::read(&out).unwrap();
    weights("import", &source, &fixed).succeeded("import again");
    assert_eq!(first, std::fs::read(&out).unwrap(), "two imports differ");

    let run = weights("info", &out, &[]).succeeded("info");
    for words in
        ["weights of a surfel network, safetensors", "stored as F16", "licence: MIT", "num_candidates", "gmdepth.pth"]
    {
        assert!(run.stdout.contains(words), "{words}: {}", run.stdout);
    }
    let run = weights("info", &source, &["--json"]).succeeded("info of the source");
    let document: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(document["format"], "PyTorch archive");
    assert_eq!(document["parts"]["transformer"]["tensors"], 32);

    let run = weights("verify", &out, &[]).succeeded("verify");
    assert!(run.stdout.contains("is good") && run.stdout.contains("the checksum is right"), "{}", run.stdout);
}

#[test]
fn a_damaged_file_fails_verification() {
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("gmdepth.pth"), folder.path().join("net.safetensors"));
    unimatch(&source, None);
    weights("import", &source, &["--preset", "tiny", "-o", out.to_str().unwrap()]).succeeded("import");
    let mut bytes = std::fs::read(&out).unwrap();
    let at = bytes.len() - 4;
    bytes[at..].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(&out, bytes).unwrap();
    let run = weights("verify", &out, &[]);
    assert_eq!(run.code, Some(1));
    assert!(run.stdout.contains("checksum") && run.stdout.contains("not a finite number"), "{}", run.stdout);
    assert!(run.stderr.contains("must not be used: 2 fault(s)"), "{}", run.stderr);
    let run = weights("verify", &out, &["--json"]);
    assert_eq!(run.code, Some(1));
    let document: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!((document["good"].as_bool(), document["faults"].as_array().unwrap().len()), (Some(false), 2));
}

#[test]
fn what_cannot_be_imported_is_refused_in_words_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("gmdepth.pth"), folder.path().join("net.safetensors"));
    let refused = |words: &[&str]| {
        let run = weights("import", &source, &["--preset", "tiny", "-o", out.to_str().unwrap()]);
        assert_eq!(run.code, Some(1), "{}", run.stdout);
        words.iter().for_each(|words| assert!(run.stderr.contains(words), "{words}: {}", run.stderr));
        assert!(!out.exists());
    };
    refused(&["gmdepth.pth"]);
    unimatch(&source, Some("backbone.layer3.1.conv2.weight"));
    refused(&["backbone.layer3.1.conv2.weight is missing"]);
    let run = weights("verify", &source, &[]);
    assert!(run.code == Some(1) && run.stderr.contains("is a PyTorch file"), "{}", run.stderr);
    std::fs::write(&source, b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.").unwrap();
    refused(&["old format", "torch.save(torch.load("]);
    std::fs::write(&source, b"no weights at all").unwrap();
    refused(&["is no PyTorch archive"]);
}
