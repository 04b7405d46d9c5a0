//! Tensors out of PyTorch's `.pt`, `.pth`, `.ckpt` and `.torch` files, and into them.
//!
//! Beside `surfel-io`: what other people trained, and the chunks of their data sets. `archive` opens the zip,
//! `pickle` rebuilds plain values from it, `tensor` decodes storages, `write` goes the other way. Invariant: a
//! file can only ever become plain values and tensors; whatever else it names is an error with that name, and
//! nothing it says reserves more memory than the file has bytes (times a small constant).

mod archive;
mod error;
mod pickle;
mod tensor;
mod value;
mod write;

pub use archive::TorchFile;
pub use error::TorchError;
pub use tensor::{Dtype, Tensor, TensorRef};
pub use value::Value;
pub use write::{Object, write};
