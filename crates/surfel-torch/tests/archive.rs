//! Archives written here: round trips, what is no PyTorch file, and what is damaged.

use proptest::prelude::*;
use std::io::{Cursor, Write};
use std::path::Path;
use surfel_torch::{Dtype, Object, Tensor, TorchError, TorchFile, Value, write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// A zip archive of these entries.
fn zipped(entries: &[(&str, &[u8])], method: CompressionMethod) -> Vec<u8> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in entries {
        archive.start_file(*name, SimpleFileOptions::default().compression_method(method)).unwrap();
        archive.write_all(bytes).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

fn written(object: &Object) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    write(object, &mut bytes).unwrap();
    bytes.into_inner()
}

fn open(bytes: &[u8]) -> Result<TorchFile<Cursor<&[u8]>>, TorchError> {
    TorchFile::from_bytes(bytes, Path::new("weights.pth"))
}

fn refusal(bytes: &[u8]) -> String {
    match open(bytes) {
        Ok(file) => panic!("accepted: {:?}", file.root()),
        Err(error) => {
            assert!(error.to_string().contains("weights.pth"), "{error}");
            error.to_string()
        }
    }
}

/// The pickle of one tensor `x` of four floats in storage `0`.
fn one_tensor() -> Object {
    Object::Dict(vec![("x".to_owned(), Object::Tensor(Tensor::from_f32(vec![2, 2], &[1.0, 2.0, 3.0, 4.0])))])
}

#[test]
fn what_is_written_is_read() {
    let tensors = [
        Tensor::from_f32(vec![2, 3], &[0.0, -1.0, 2.5, f32::MAX, 1e-40, 7.0]),
        Tensor::from_bytes(Dtype::U8, vec![3], vec![1, 2, 255]),
        Tensor::from_bytes(Dtype::I64, vec![], 5i64.to_le_bytes().to_vec()),
        Tensor::from_f32(vec![3, 0, 2], &[]),
    ];
    let mut items: Vec<Object> = tensors.iter().cloned().map(Object::Tensor).collect();
    items.extend([Object::None, Object::Bool(true), Object::Int(-7), Object::Int(1 << 40), Object::Float(0.25)]);
    // More than one batch.
    items.push(Object::List((0..2500).map(Object::Int).collect()));
    let object = Object::Dict(vec![("key ä".to_owned(), Object::List(items))]);
    let bytes = written(&object);
    assert_eq!(bytes, written(&object));
    let mut file = open(&bytes).unwrap();
    let list = file.root().get("key ä").unwrap().as_list().unwrap().to_vec();
    for (tensor, value) in tensors.iter().zip(&list) {
        assert_eq!(&file.tensor(value.as_tensor().unwrap()).unwrap(), tensor);
    }
    let ramp = Value::List((0..2500).map(Value::Int).collect());
    let plain = [Value::None, Value::Bool(true), Value::Int(-7), Value::Int(1 << 40), Value::Float(0.25), ramp];
    assert_eq!(list[4..], plain);
}

#[test]
fn other_kinds_of_files_are_named() {
    assert!(refusal(b"").contains("it is empty"));
    assert!(refusal(b"\x89PNG\r\n\x1a\n").contains("does not begin as a zip archive"));
    assert!(refusal(b"\x40\0\0\0\0\0\0\0{\"x\":1}").contains("safetensors"));
    assert!(refusal(b"\x80\x04\x95\x03\0\0\0").contains("bare Python pickle"));
    let stored = CompressionMethod::Stored;
    assert!(refusal(&zipped(&[("a.npy", b"x")], stored)).contains("holds no data.pkl"));
    assert!(refusal(&zipped(&[("m/data.pkl", b"x"), ("m/constants.pkl", b"x")], stored)).contains("TorchScript"));
    assert!(refusal(&zipped(&[("m/data.pkl", b"x"), ("m/byteorder", b"big")], stored)).contains("big-endian"));
    let deflated = zipped(&[("m/data.pkl", &[b'N'; 4000])], CompressionMethod::Deflated);
    assert!(refusal(&deflated).contains("is compressed, which torch.save never does"));
    let missing = TorchFile::open(Path::new("no such file.pth")).err().unwrap();
    assert!(missing.to_string().contains("no such file.pth"), "{missing}");
}

#[test]
fn an_archive_may_have_any_folder() {
    for folder in ["", "archive/", "epoch_3-step_9/"] {
        let bytes = zipped(&[(&format!("{folder}data.pkl"), b"\x80\x02K\x05.")], CompressionMethod::Stored);
        assert_eq!(open(&bytes).unwrap().root(), &Value::Int(5), "{folder}");
    }
}

#[test]
fn a_missing_or_short_storage_is_an_error_of_its_tensor() {
    let whole = written(&one_tensor());
    let mut archive = zip::ZipArchive::new(Cursor::new(whole)).unwrap();
    let mut program = Vec::new();
    std::io::copy(&mut archive.by_name("archive/data.pkl").unwrap(), &mut program).unwrap();
    for (storage, words) in [(None, "data/0 cannot be read"), (Some(15), "fewer bytes"), (Some(17), "more than the 16")]
    {
        let data = vec![0u8; storage.unwrap_or(0)];
        let mut entries = vec![("a/data.pkl", program.as_slice())];
        entries.extend(storage.map(|_| ("a/data/0", data.as_slice())));
        let bytes = zipped(&entries, CompressionMethod::Stored);
        let mut file = open(&bytes).unwrap();
        let tensor = file.root().get("x").unwrap().as_tensor().unwrap().clone();
        let error = file.tensor(&tensor).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("weights.pth"), "{error}");
    }
}

#[test]
fn half_a_file_is_not_complete() {
    let bytes = written(&one_tensor());
    assert!(refusal(&bytes[..bytes.len() / 2]).contains("not complete"));
}

proptest! {
    #[test]
    fn damaged_files_never_panic(
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
        keep in 0.5f64..1.1,
    ) {
        let mut bytes = written(&one_tensor());
        for (index, byte) in &edits {
            let at = index.index(bytes.len());
            bytes[at] = *byte;
        }
        bytes.truncate((keep * bytes.len() as f64) as usize);
        if let Ok(mut file) = open(&bytes)
            && let Some(tensor) = file.root().get("x").and_then(Value::as_tensor).cloned()
        {
            let _ = file.tensor(&tensor);
        }
    }
}
