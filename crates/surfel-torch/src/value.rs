//! What a PyTorch file holds, as a plain tree.
//!
//! Strings, byte strings and tensors are shared, because a file may mention one a million times. Invariant: a
//! tree is at most as deep and as large as `pickle` allows, so walking it recursively is safe.

use crate::tensor::TensorRef;
use std::sync::Arc;

/// A plain value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// `None`.
    None,
    /// `True` or `False`.
    Bool(bool),
    /// An integer of at most 64 bits.
    Int(i64),
    /// A float.
    Float(f64),
    /// A string.
    Str(Arc<str>),
    /// A byte string.
    Bytes(Arc<[u8]>),
    /// A list.
    List(Vec<Value>),
    /// A tuple.
    Tuple(Vec<Value>),
    /// A `dict` or `OrderedDict`, in order.
    Dict(Vec<(Value, Value)>),
    /// A tensor or parameter; [`crate::TorchFile::tensor`] reads its values.
    Tensor(Arc<TensorRef>),
}

impl Value {
    /// The entry of a dictionary under a string; `None` also for anything that is no dictionary.
    pub fn get(&self, key: &str) -> Option<&Value> {
        let entries = self.as_dict()?;
        // As in Python, the last of several equal keys counts.
        entries.iter().rev().find(|(name, _)| name.as_str() == Some(key)).map(|(_, value)| value)
    }

    /// The entries of a dictionary.
    pub fn as_dict(&self) -> Option<&[(Value, Value)]> {
        if let Self::Dict(entries) = self { Some(entries) } else { None }
    }

    /// The elements of a list or tuple.
    pub fn as_list(&self) -> Option<&[Value]> {
        if let Self::List(items) | Self::Tuple(items) = self { Some(items) } else { None }
    }

    /// The text of a string.
    pub fn as_str(&self) -> Option<&str> {
        if let Self::Str(text) = self { Some(text) } else { None }
    }

    /// The bytes of a byte string.
    pub fn as_bytes(&self) -> Option<&[u8]> {
        if let Self::Bytes(bytes) = self { Some(bytes) } else { None }
    }

    /// A tensor's description.
    pub fn as_tensor(&self) -> Option<&Arc<TensorRef>> {
        if let Self::Tensor(tensor) = self { Some(tensor) } else { None }
    }

    /// What it is, in Python's words, for messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::None => "None",
            Self::Bool(_) => "a bool",
            Self::Int(_) => "an int",
            Self::Float(_) => "a float",
            Self::Str(_) => "a str",
            Self::Bytes(_) => "bytes",
            Self::List(_) => "a list",
            Self::Tuple(_) => "a tuple",
            Self::Dict(_) => "a dict",
            Self::Tensor(_) => "a tensor",
        }
    }
}
