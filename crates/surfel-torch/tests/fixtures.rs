//! Files written by PyTorch itself (`fixtures/make.py`), and what they hold.

use std::path::{Path, PathBuf};
use surfel_torch::{Dtype, Tensor, TorchError, TorchFile, Value};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

/// A tensor of the root dictionary.
fn tensor(name: &str, key: &str) -> Tensor {
    let mut file = TorchFile::open(&fixture(name)).unwrap();
    let tensor = file.root().get(key).unwrap_or_else(|| panic!("{name} has no {key}")).as_tensor().unwrap().clone();
    file.tensor(&tensor).unwrap()
}

const BOTH: [&str; 2] = ["protocol2.pt", "protocol4.pt"];

#[test]
fn every_type_of_tensor() {
    for name in BOTH {
        let check = |key: &str, dtype: Dtype, shape: &[usize], values: &[f64]| {
            let tensor = tensor(name, key);
            assert_eq!((tensor.dtype, tensor.shape.as_slice()), (dtype, shape), "{key}");
            assert_eq!(tensor.to_f64(), values, "{name}: {key}");
        };
        let ramp: Vec<f64> = (0..24).map(f64::from).collect();
        check("f32", Dtype::F32, &[2, 3, 4], &ramp);
        check("f16", Dtype::F16, &[4], &[0.0, 0.5, 1.0, 1.5]);
        check("bf16", Dtype::Bf16, &[4], &[0.0, 0.5, 1.0, 1.5]);
        check("f64", Dtype::F64, &[4], &[0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0]);
        check("u8", Dtype::U8, &[2], &[0.0, 255.0]);
        check("i8", Dtype::I8, &[2], &[-128.0, 127.0]);
        check("i16", Dtype::I16, &[2], &[-32768.0, 32767.0]);
        check("i32", Dtype::I32, &[2], &[f64::from(i32::MIN), f64::from(i32::MAX)]);
        check("bool", Dtype::Bool, &[2], &[1.0, 0.0]);
        check("scalar", Dtype::F32, &[], &[2.5]);
        check("empty", Dtype::F32, &[0, 3], &[]);
        check("parameter", Dtype::F32, &[3], &[5.0, 6.0, 7.0]);
        assert_eq!(tensor(name, "i64").to_i64().unwrap(), [i64::MIN, i64::MAX]);
    }
}

#[test]
fn every_kind_of_view() {
    for name in BOTH {
        let transposed = tensor(name, "transposed");
        let expected: Vec<f32> =
            (0..4).flat_map(|k| (0..3).flat_map(move |j| (0..2).map(move |i| (12 * i + 4 * j + k) as f32))).collect();
        assert_eq!((transposed.shape.as_slice(), transposed.to_f32()), ([4, 3, 2].as_slice(), expected));
        let columns: Vec<f32> = (0..24).filter(|i| i % 2 == 1).map(|i| i as f32).collect();
        assert_eq!(tensor(name, "every other column").to_f32(), columns);
        let expanded = tensor(name, "expanded");
        assert_eq!((expanded.shape.as_slice(), expanded.to_f32()), ([2, 2].as_slice(), vec![7.0; 4]));
    }
}

#[test]
fn every_plain_value() {
    for name in BOTH {
        let file = TorchFile::open(&fixture(name)).unwrap();
        let tuple = |values: &[i64]| Value::Tuple(values.iter().map(|&v| Value::Int(v)).collect());
        let plain = vec![
            Value::None,
            Value::Bool(true),
            Value::Bool(false),
            Value::Int(0),
            Value::Int(-1),
            Value::Int(255),
            Value::Int(65535),
            Value::Int(i64::from(i32::MIN)),
            Value::Int(1 << 40),
            Value::Float(0.5),
            Value::Str("Fläche".into()),
            Value::Bytes([0, 255].as_slice().into()),
            tuple(&[1]),
            tuple(&[1, 2, 3, 4]),
        ];
        assert_eq!(file.root().get("plain"), Some(&Value::List(plain)));
        let inner = Value::Dict(vec![(Value::Str("a".into()), Value::List(Vec::new()))]);
        let pair = Value::Tuple(vec![Value::Tuple(Vec::new()), Value::Dict(Vec::new())]);
        let nested = Value::Dict(vec![(Value::Str("b".into()), inner), (Value::Int(3), pair)]);
        assert_eq!(file.root().get("nested"), Some(&nested));
    }
}

#[test]
fn the_weights_of_a_module() {
    let mut file = TorchFile::open(&fixture("module.ckpt")).unwrap();
    assert_eq!(file.root().get("global_step"), Some(&Value::Int(7)));
    let entries = file.root().get("state_dict").unwrap().as_dict().unwrap().to_vec();
    let names: Vec<&str> = entries.iter().map(|(name, _)| name.as_str().unwrap()).collect();
    assert_eq!(names, ["0.weight", "0.bias", "1.weight", "1.bias"]);
    for (i, shape) in [vec![2, 1, 3, 3], vec![2], vec![2], vec![2]].into_iter().enumerate() {
        let tensor = file.tensor(entries[i].1.as_tensor().unwrap()).unwrap();
        assert_eq!(tensor.shape, shape);
        assert!(tensor.to_f32().iter().all(|value| *value == i as f32 + 0.5));
    }
}

#[test]
fn a_class_is_refused_by_name() {
    let error = TorchFile::open(&fixture("forbidden.pt")).err().unwrap();
    assert!(matches!(&error, TorchError::Forbidden { global, .. } if global == "fractions.Fraction"), "{error}");
    let sentence = error.to_string();
    assert!(sentence.contains("forbidden.pt wants to load `fractions.Fraction`"), "{sentence}");
    assert!(sentence.contains("torch.save("), "{sentence}");
}

#[test]
fn the_old_format_is_refused_with_the_way_to_convert_it() {
    let error = TorchFile::open(&fixture("legacy.pth")).err().unwrap();
    assert!(matches!(error, TorchError::Legacy { .. }), "{error}");
    assert!(error.to_string().contains("torch.save(torch.load("), "{error}");
}
