//! A pickle machine that can build plain values and tensors, and nothing else.
//!
//! Python's pickle is a program for a stack machine whose `GLOBAL` and `REDUCE` may call any function. Here the
//! functions are the handful of [`globals::Global`]. Protocols 2 to 5, as `torch.save` writes them. Invariant:
//! time and memory are bounded by the number of opcodes, which is bounded, whatever the program says.

mod bytes;
mod globals;
mod machine;
mod tree;

#[cfg(test)]
mod damaged;

use crate::error::Fault;
use crate::value::Value;

/// The value that a pickle describes.
pub(crate) fn parse(program: &[u8]) -> Result<Value, Fault> {
    let (root, arena) = machine::Machine::new(program).run()?;
    tree::value_of(&root, &arena)
}
