//! The only names a file may mention, and what calling them does.
//!
//! Invariant: none of them has an effect; each turns plain arguments into a plain value or a tensor.

use super::machine::{Arena, Node, Slot};
use crate::error::Fault;
use crate::tensor::{Dtype, Storage, TensorRef};
use std::sync::Arc;

/// A name that is allowed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Global {
    /// `collections.OrderedDict`
    OrderedDict,
    /// `torch._utils._rebuild_tensor_v2`
    RebuildTensor,
    /// `torch._utils._rebuild_parameter`
    RebuildParameter,
    /// `_codecs.encode`, by which Python 3 writes `bytes` in protocol 2; Latin-1 only.
    Encode,
    /// `torch.FloatStorage` and its sisters.
    Storage(Dtype),
}

impl Global {
    pub fn find(module: &str, name: &str) -> Result<Self, Fault> {
        let storage = || Dtype::STORAGES.iter().find(|(storage, _)| *storage == name).map(|(_, dtype)| *dtype);
        match (module, name) {
            ("collections", "OrderedDict") => Some(Self::OrderedDict),
            ("torch._utils", "_rebuild_tensor_v2") => Some(Self::RebuildTensor),
            ("torch._utils", "_rebuild_parameter") => Some(Self::RebuildParameter),
            ("_codecs", "encode") => Some(Self::Encode),
            ("torch", _) => storage().map(Self::Storage),
            _ => None,
        }
        .ok_or_else(|| Fault::Forbidden(format!("{module}.{name}").escape_debug().to_string()))
    }

    /// The result of calling it, as `REDUCE` does.
    pub fn call(self, arguments: &[Slot], arena: &mut Arena) -> Result<Slot, Fault> {
        match (self, arguments) {
            (Self::OrderedDict, []) => arena.add(Node::Dict(Vec::new())),
            (Self::OrderedDict, [items]) => {
                let pairs = pairs(items, arena).ok_or_else(|| wrong_arguments(self))?;
                arena.add(Node::Dict(pairs))
            }
            // Gradients, hooks and metadata say nothing about the values.
            (Self::RebuildTensor, [Slot::Storage(storage), offset, shape, strides, ..]) => {
                let offset = size(offset).ok_or_else(|| wrong_arguments(self))?;
                let shape = sizes(shape, arena).ok_or_else(|| wrong_arguments(self))?;
                let strides = sizes(strides, arena).ok_or_else(|| wrong_arguments(self))?;
                Ok(Slot::Tensor(Arc::new(TensorRef::new(storage.clone(), offset, shape, strides)?)))
            }
            (Self::RebuildParameter, [Slot::Tensor(tensor), ..]) => Ok(Slot::Tensor(tensor.clone())),
            (Self::Encode, [Slot::Text(text), Slot::Text(encoding)]) if &**encoding == "latin1" => {
                let bytes: Option<Vec<u8>> = text.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect();
                Ok(Slot::Bytes(bytes.ok_or_else(|| wrong_arguments(self))?.into()))
            }
            _ => Err(wrong_arguments(self)),
        }
    }
}

/// The storage that a persistent id stands for: `("storage", type, key, device, elements)`.
pub(super) fn storage(id: &Slot, arena: &Arena) -> Result<Slot, Fault> {
    let fields = arena.items(id).unwrap_or_default();
    match fields {
        [Slot::Text(kind), Slot::Global(Global::Storage(dtype)), Slot::Text(key), _, len, ..]
            if &**kind == "storage" =>
        {
            let len = size(len).ok_or_else(|| Fault::text("describes a storage without a usable length"))?;
            Ok(Slot::Storage(Arc::new(Storage { dtype: *dtype, key: key.clone(), len })))
        }
        _ => Err(Fault::text("refers to something outside itself that is no tensor storage")),
    }
}

fn size(slot: &Slot) -> Option<usize> {
    if let Slot::Int(value) = slot { usize::try_from(*value).ok() } else { None }
}

fn sizes(slot: &Slot, arena: &Arena) -> Option<Vec<usize>> {
    arena.items(slot)?.iter().map(size).collect()
}

fn pairs(items: &Slot, arena: &Arena) -> Option<Vec<(Slot, Slot)>> {
    let pair = |item: &Slot| match arena.items(item)? {
        [key, value] => Some((key.clone(), value.clone())),
        _ => None,
    };
    arena.items(items)?.iter().map(pair).collect()
}

fn wrong_arguments(global: Global) -> Fault {
    Fault::text(format!("calls {global:?} with arguments that torch.save never writes; it is damaged"))
}
