//! From containers that refer to each other by number to one tree of values.
//!
//! A container mentioned twice appears twice. Invariant: the tree has at most [`MAX_VALUES`] values and
//! [`MAX_DEPTH`] levels, so neither a container inside itself nor one that doubles forty times over gets through.

use super::machine::{Arena, Node, Slot};
use crate::error::Fault;
use crate::value::Value;

const MAX_VALUES: usize = 1 << 22;
const MAX_DEPTH: usize = 64;

pub(super) fn value_of(root: &Slot, arena: &Arena) -> Result<Value, Fault> {
    Builder { arena, left: MAX_VALUES }.value(root, 0)
}

struct Builder<'a> {
    arena: &'a Arena,
    left: usize,
}

impl Builder<'_> {
    fn value(&mut self, slot: &Slot, depth: usize) -> Result<Value, Fault> {
        self.left = self
            .left
            .checked_sub(1)
            .ok_or_else(|| Fault::text(format!("holds more than {MAX_VALUES} values; it is more than tensors")))?;
        match slot {
            Slot::None => Ok(Value::None),
            Slot::Bool(value) => Ok(Value::Bool(*value)),
            Slot::Int(value) => Ok(Value::Int(*value)),
            Slot::Float(value) => Ok(Value::Float(*value)),
            Slot::Text(text) => Ok(Value::Str(text.clone())),
            Slot::Bytes(bytes) => Ok(Value::Bytes(bytes.clone())),
            Slot::Tensor(tensor) => Ok(Value::Tensor(tensor.clone())),
            Slot::Node(_) if depth == MAX_DEPTH => {
                Err(Fault::text(format!("nests lists and dicts more than {MAX_DEPTH} deep")))
            }
            Slot::Node(id) => match &self.arena.0[*id] {
                Node::List(items) => self.values(items, depth).map(Value::List),
                Node::Tuple(items) => self.values(items, depth).map(Value::Tuple),
                Node::Dict(entries) => {
                    let mut entry =
                        |(key, value): &(Slot, Slot)| Ok((self.value(key, depth + 1)?, self.value(value, depth + 1)?));
                    entries.iter().map(&mut entry).collect::<Result<_, _>>().map(Value::Dict)
                }
            },
            Slot::Global(_) | Slot::Storage(_) => {
                Err(Fault::text("holds a bare type or storage where a value or tensor belongs"))
            }
        }
    }

    fn values(&mut self, items: &[Slot], depth: usize) -> Result<Vec<Value>, Fault> {
        items.iter().map(|item| self.value(item, depth + 1)).collect()
    }
}
