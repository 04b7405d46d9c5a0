//! Writes what [`crate::TorchFile`] reads, so that `torch.load` opens it: weights for PyTorch, chunks for its data sets.
//!
//! Pickle protocol 2, one storage per tensor, entries stored on 64-byte boundaries as PyTorch does. Invariant: the same
//! object gives the same bytes.

use crate::tensor::Tensor;
use std::io::{Result, Seek, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Largest batch between two marks; Python's own is the same.
const BATCH: usize = 1000;

/// A plain value or tensor to write.
#[derive(Clone, Debug, PartialEq)]
pub enum Object {
    /// `None`.
    None,
    /// `True` or `False`.
    Bool(bool),
    /// An integer.
    Int(i64),
    /// A float.
    Float(f64),
    /// A string.
    Str(String),
    /// A list.
    List(Vec<Object>),
    /// A `dict` with string keys, in order.
    Dict(Vec<(String, Object)>),
    /// A tensor.
    Tensor(Tensor),
}

/// Writes `object` as `torch.save` would.
///
/// # Errors
/// Those of `writer`.
pub fn write<W: Write + Seek>(object: &Object, writer: W) -> Result<()> {
    let mut pickler = Pickler { program: vec![0x80, 2], storages: Vec::new() };
    pickler.object(object);
    pickler.program.push(b'.');
    let mut archive = ZipWriter::new(writer);
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored).with_alignment(64);
    let mut entry = |name: &str, bytes: &[u8]| {
        archive.start_file(format!("archive/{name}"), options.large_file(bytes.len() >= 1 << 31))?;
        archive.write_all(bytes)
    };
    entry("data.pkl", &pickler.program)?;
    entry("byteorder", b"little")?;
    for (key, tensor) in pickler.storages.iter().enumerate() {
        entry(&format!("data/{key}"), tensor.bytes())?;
    }
    entry("version", b"3\n")?;
    archive.finish()?.flush()
}

struct Pickler<'a> {
    program: Vec<u8>,
    storages: Vec<&'a Tensor>,
}

impl<'a> Pickler<'a> {
    fn object(&mut self, object: &'a Object) {
        match object {
            Object::None => self.program.push(b'N'),
            Object::Bool(value) => self.program.push(if *value { 0x88 } else { 0x89 }),
            Object::Int(value) => self.int(*value),
            Object::Float(value) => {
                self.program.push(b'G');
                self.program.extend(value.to_be_bytes());
            }
            Object::Str(text) => self.text(text),
            Object::List(items) => {
                self.program.push(b']');
                for batch in items.chunks(BATCH) {
                    self.program.push(b'(');
                    batch.iter().for_each(|item| self.object(item));
                    self.program.push(b'e');
                }
            }
            Object::Dict(entries) => {
                self.program.push(b'}');
                for batch in entries.chunks(BATCH) {
                    self.program.push(b'(');
                    for (key, value) in batch {
                        self.text(key);
                        self.object(value);
                    }
                    self.program.push(b'u');
                }
            }
            Object::Tensor(tensor) => self.tensor(tensor),
        }
    }

    fn int(&mut self, value: i64) {
        match i32::try_from(value) {
            Ok(small) => {
                self.program.push(b'J');
                self.program.extend(small.to_le_bytes());
            }
            Err(_) => {
                self.program.extend([0x8a, 8]);
                self.program.extend(value.to_le_bytes());
            }
        }
    }

    fn text(&mut self, text: &str) {
        self.program.push(b'X');
        self.program.extend((text.len() as u32).to_le_bytes());
        self.program.extend(text.bytes());
    }

    /// `_rebuild_tensor_v2(storage, 0, shape, strides, False, OrderedDict())`
    fn tensor(&mut self, tensor: &'a Tensor) {
        self.program.extend(b"ctorch._utils\n_rebuild_tensor_v2\n((");
        self.text("storage");
        self.program.extend(format!("ctorch\n{}\n", tensor.dtype.storage_name()).bytes());
        self.text(&self.storages.len().to_string());
        self.text("cpu");
        self.int((tensor.bytes().len() / tensor.dtype.size()) as i64);
        self.program.extend(b"tQ");
        self.int(0);
        self.sizes(tensor.shape.iter().copied());
        let mut strides = vec![1; tensor.shape.len()];
        for dim in (1..tensor.shape.len()).rev() {
            strides[dim - 1] = strides[dim] * tensor.shape[dim].max(1);
        }
        self.sizes(strides.into_iter());
        self.program.push(0x89);
        self.program.extend(b"ccollections\nOrderedDict\n)RtR");
        self.storages.push(tensor);
    }

    fn sizes(&mut self, sizes: impl Iterator<Item = usize>) {
        self.program.push(b'(');
        sizes.for_each(|size| self.int(size as i64));
        self.program.push(b't');
    }
}
