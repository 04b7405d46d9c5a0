//! The stack machine: opcodes in, a root and the containers it refers to out.
//!
//! Containers live in an arena and are referred to by number, as later opcodes may still fill them. Invariant: a
//! program runs for at most [`MAX_OPCODES`] steps and each step adds a bounded amount.

use super::bytes::Bytes;
use super::globals::{self, Global};
use crate::error::Fault;
use crate::tensor::{Storage, TensorRef};
use std::collections::HashMap;
use std::sync::Arc;

/// A chunk of RealEstate10K takes a few hundred thousand, a large checkpoint some ten thousand.
const MAX_OPCODES: usize = 1 << 23;

/// What lies on the stack: small or shared, so copying is cheap.
#[derive(Clone, Debug)]
pub(super) enum Slot {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    Text(Arc<str>),
    Bytes(Arc<[u8]>),
    Global(Global),
    Storage(Arc<Storage>),
    Tensor(Arc<TensorRef>),
    /// Number of a container in the arena.
    Node(usize),
}

/// A container.
#[derive(Debug)]
pub(super) enum Node {
    List(Vec<Slot>),
    Tuple(Vec<Slot>),
    Dict(Vec<(Slot, Slot)>),
}

/// All containers.
#[derive(Debug, Default)]
pub(super) struct Arena(pub Vec<Node>);

impl Arena {
    pub fn add(&mut self, node: Node) -> Result<Slot, Fault> {
        self.0.push(node);
        Ok(Slot::Node(self.0.len() - 1))
    }

    /// The elements of a list or tuple.
    pub fn items(&self, slot: &Slot) -> Option<&[Slot]> {
        match slot {
            Slot::Node(id) => match &self.0[*id] {
                Node::List(items) | Node::Tuple(items) => Some(items),
                Node::Dict(_) => None,
            },
            _ => None,
        }
    }
}

pub(super) struct Machine<'a> {
    program: Bytes<'a>,
    stack: Vec<Slot>,
    /// Heights of the stack at the open marks.
    marks: Vec<usize>,
    memo: HashMap<usize, Slot>,
    arena: Arena,
}

impl<'a> Machine<'a> {
    pub fn new(program: &'a [u8]) -> Self {
        let (stack, marks) = (Vec::new(), Vec::new());
        Self { program: Bytes(program), stack, marks, memo: HashMap::new(), arena: Arena::default() }
    }

    pub fn run(mut self) -> Result<(Slot, Arena), Fault> {
        for _ in 0..MAX_OPCODES {
            let opcode = self.program.u8()? as u8;
            if opcode == b'.' {
                let root = self.pop()?;
                return Ok((root, self.arena));
            }
            self.step(opcode)?;
        }
        Err(Fault::text(format!("takes more than {MAX_OPCODES} steps to describe; it holds more than tensors")))
    }

    fn step(&mut self, opcode: u8) -> Result<(), Fault> {
        match opcode {
            // Protocol and frames.
            0x80 => match self.program.u8()? {
                2..=5 => Ok(()),
                version => Err(Fault::text(format!("is written in pickle protocol {version}, and 2 to 5 are read"))),
            },
            0x95 => self.program.array::<8>().map(drop),
            // Plain values.
            b'N' => self.push(Slot::None),
            0x88 => self.push(Slot::Bool(true)),
            0x89 => self.push(Slot::Bool(false)),
            b'K' => self.program.u8().and_then(|value| self.push(Slot::Int(value as i64))),
            b'M' => self.program.u16().and_then(|value| self.push(Slot::Int(value as i64))),
            b'J' => self.program.array().and_then(|b| self.push(Slot::Int(i64::from(i32::from_le_bytes(b))))),
            b'G' => self.program.array().and_then(|b| self.push(Slot::Float(f64::from_be_bytes(b)))),
            0x8a => self.program.u8().and_then(|len| self.long(len)),
            0x8b => self.program.u32().and_then(|len| self.long(len)),
            b'X' => self.program.u32().and_then(|len| self.text(len)),
            0x8c => self.program.u8().and_then(|len| self.text(len)),
            0x8d => self.program.u64().and_then(|len| self.text(len)),
            b'C' => self.program.u8().and_then(|len| self.bytes(len)),
            b'B' => self.program.u32().and_then(|len| self.bytes(len)),
            0x8e => self.program.u64().and_then(|len| self.bytes(len)),
            // Containers.
            b')' => self.container(Node::Tuple(Vec::new())),
            b']' => self.container(Node::List(Vec::new())),
            b'}' => self.container(Node::Dict(Vec::new())),
            b'(' => {
                self.marks.push(self.stack.len());
                Ok(())
            }
            b't' => self.pop_mark().and_then(|items| self.container(Node::Tuple(items))),
            b'l' => self.pop_mark().and_then(|items| self.container(Node::List(items))),
            b'd' => self.pop_mark().and_then(|items| self.container(Node::Dict(in_pairs(items)?))),
            0x85..=0x87 => {
                let items = self.pop_many(usize::from(opcode - 0x84))?;
                self.container(Node::Tuple(items))
            }
            b'a' => self.pop().and_then(|item| self.append(vec![item])),
            b'e' => self.pop_mark().and_then(|items| self.append(items)),
            b's' => self.pop_many(2).and_then(|items| self.insert(items)),
            b'u' => self.pop_mark().and_then(|items| self.insert(items)),
            // The stack and the memo.
            b'0' => self.pop().map(drop),
            b'1' => self.pop_mark().map(drop),
            b'2' => self.top().cloned().and_then(|top| self.push(top)),
            b'q' => self.program.u8().and_then(|index| self.remember(index)),
            b'r' => self.program.u32().and_then(|index| self.remember(index)),
            0x94 => self.remember(self.memo.len()),
            b'h' => self.program.u8().and_then(|index| self.recall(index)),
            b'j' => self.program.u32().and_then(|index| self.recall(index)),
            // Names and calls.
            b'c' => {
                let (module, name) = (self.program.line()?, self.program.line()?);
                self.push(Slot::Global(Global::find(module, name)?))
            }
            0x93 => match self.pop_many(2)?.as_slice() {
                [Slot::Text(module), Slot::Text(name)] => self.push(Slot::Global(Global::find(module, name)?)),
                _ => Err(Fault::text("names something by what is no string; it is damaged")),
            },
            b'R' => self.call(),
            b'b' => self.set_state(),
            b'Q' => self.pop().and_then(|id| globals::storage(&id, &self.arena)).and_then(|slot| self.push(slot)),
            _ => Err(Fault::text(format!(
                "holds the pickle opcode 0x{opcode:02x}, which torch.save does not write for tensors and plain values"
            ))),
        }
    }

    fn push(&mut self, slot: Slot) -> Result<(), Fault> {
        self.stack.push(slot);
        Ok(())
    }

    fn long(&mut self, len: usize) -> Result<(), Fault> {
        self.program.long(len).and_then(|value| self.push(Slot::Int(value)))
    }

    fn text(&mut self, len: usize) -> Result<(), Fault> {
        self.program.text(len).and_then(|text| self.push(Slot::Text(text.into())))
    }

    fn bytes(&mut self, len: usize) -> Result<(), Fault> {
        self.program.take(len).and_then(|bytes| self.push(Slot::Bytes(bytes.into())))
    }

    fn container(&mut self, node: Node) -> Result<(), Fault> {
        self.arena.add(node).and_then(|slot| self.push(slot))
    }

    /// The lowest height that pops may reach: the innermost open mark.
    fn floor(&self) -> usize {
        self.marks.last().copied().unwrap_or(0)
    }

    fn pop(&mut self) -> Result<Slot, Fault> {
        let floor = self.floor();
        if self.stack.len() <= floor {
            return Err(empty_stack());
        }
        self.stack.pop().ok_or_else(empty_stack)
    }

    fn pop_many(&mut self, count: usize) -> Result<Vec<Slot>, Fault> {
        let from = self.stack.len().checked_sub(count).filter(|from| *from >= self.floor());
        Ok(self.stack.split_off(from.ok_or_else(empty_stack)?))
    }

    fn pop_mark(&mut self) -> Result<Vec<Slot>, Fault> {
        let from = self.marks.pop().ok_or_else(|| Fault::text("closes a mark that was never opened; it is damaged"))?;
        Ok(self.stack.split_off(from))
    }

    fn top(&self) -> Result<&Slot, Fault> {
        self.stack[self.floor().min(self.stack.len())..].last().ok_or_else(empty_stack)
    }

    fn remember(&mut self, index: usize) -> Result<(), Fault> {
        let slot = self.top()?.clone();
        self.memo.insert(index, slot);
        Ok(())
    }

    fn recall(&mut self, index: usize) -> Result<(), Fault> {
        let slot = self.memo.get(&index).cloned();
        self.push(slot.ok_or_else(|| Fault::text("recalls a value it never remembered; it is damaged"))?)
    }

    /// The container on top of the stack.
    fn top_node(&mut self) -> Result<&mut Node, Fault> {
        match *self.top()? {
            Slot::Node(id) => Ok(&mut self.arena.0[id]),
            _ => Err(Fault::text("fills something that is no list or dict; it is damaged")),
        }
    }

    fn append(&mut self, items: Vec<Slot>) -> Result<(), Fault> {
        match self.top_node()? {
            Node::List(list) => list.extend(items),
            _ => return Err(Fault::text("appends to something that is no list; it is damaged")),
        }
        Ok(())
    }

    fn insert(&mut self, items: Vec<Slot>) -> Result<(), Fault> {
        let pairs = in_pairs(items)?;
        match self.top_node()? {
            Node::Dict(dict) => dict.extend(pairs),
            _ => return Err(Fault::text("inserts into something that is no dict; it is damaged")),
        }
        Ok(())
    }

    fn call(&mut self) -> Result<(), Fault> {
        let called = self.pop_many(2)?;
        let [Slot::Global(global), arguments] = &called[..] else {
            return Err(Fault::text("calls something that is no function; it is damaged"));
        };
        let arguments = self.arena.items(arguments).ok_or_else(|| Fault::text("calls without arguments"))?.to_vec();
        let result = global.call(&arguments, &mut self.arena)?;
        self.push(result)
    }

    /// Attributes of an `OrderedDict` (a module's version numbers) are left out.
    fn set_state(&mut self) -> Result<(), Fault> {
        self.pop()?;
        match self.top_node()? {
            Node::Dict(_) => Ok(()),
            _ => Err(Fault::text("sets attributes of something that is no OrderedDict; it is damaged")),
        }
    }
}

fn in_pairs(items: Vec<Slot>) -> Result<Vec<(Slot, Slot)>, Fault> {
    let (pairs, rest) = items.as_chunks::<2>();
    if !rest.is_empty() {
        return Err(Fault::text("has a dict with a key and no value; it is damaged"));
    }
    Ok(pairs.iter().map(|[key, value]| (key.clone(), value.clone())).collect())
}

fn empty_stack() -> Fault {
    Fault::text("takes a value that was never given; it is damaged")
}
