//! What a tensor holds, out of the graph and off the device.
//!
//! Where hand-written code reads what layers computed. Invariant: row-major, and nothing is rounded.

use burn::tensor::Tensor;

/// A tensor's values, row-major.
///
/// # Panics
/// If the tensor is not of f32, in which every network here runs.
pub fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec().expect("a network runs in f32")
}
