//! Our kernels for graphics cards, in CubeCL: one file per operator, each a twin of the code on plain slices.
//!
//! Called by `ops/kernel/cube.rs` where an operator has one. Every number that is written is gathered by one unit, in a
//! fixed order. Invariant: no result depends on which unit comes first, so a card repeats itself to the last bit.

mod conv;
mod propagate;
mod sweep;

pub(super) use conv::{conv, conv_gradients};
pub(super) use propagate::{propagate, propagate_gradients};
pub(super) use sweep::sweep;

use burn::backend::DType;
use burn::backend::ops::{FloatTensorOps, IntTensorOps};
use burn::backend::tensor::FloatTensor;
use burn::tensor::TensorData;
use burn_cubecl::cubecl::calculate_cube_count_elemwise;
use burn_cubecl::cubecl::client::Client;
use burn_cubecl::cubecl::prelude::{BufferArg, CubeCount, CubeDim};
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::tensor::CubeTensor;
use burn_cubecl::{CubeBackend, CubeDevice};

/// A tensor on a card.
pub(super) type OnCard = FloatTensor<CubeBackend>;

/// Units of a cube.
const UNITS: u32 = 128;

/// Where the inputs of a call are and its outputs go.
struct Card {
    client: Client,
    device: CubeDevice,
}

impl Card {
    fn of(tensor: &OnCard) -> Self {
        Self { client: tensor.client.clone(), device: tensor.device.clone() }
    }

    /// A tensor for a kernel to fill.
    fn empty(&self, shape: &[usize]) -> OnCard {
        let handle = self.client.empty(shape.iter().product::<usize>() * size_of::<f32>());
        CubeTensor::new_contiguous(self.client.clone(), self.device.clone(), shape.into(), handle, DType::F32)
    }

    /// Numbers of the host as an argument.
    fn floats(&self, values: Vec<f32>) -> BufferArg {
        let length = values.len();
        CubeBackend::float_from_data(TensorData::new(values, [length]), &self.device).into_buffer_arg()
    }

    /// Whole numbers of the host as an argument.
    fn integers(&self, values: Vec<i32>) -> BufferArg {
        let length = values.len();
        CubeBackend::int_from_data(TensorData::new(values, [length]), &self.device).into_buffer_arg()
    }

    /// Cubes and their size for `count` units at least.
    fn units(&self, count: usize) -> (CubeCount, CubeDim) {
        let dim = CubeDim::new_1d(UNITS);
        (calculate_cube_count_elemwise(&self.client, count, dim), dim)
    }
}

/// The values of a tensor, row-major.
fn values(tensor: &OnCard) -> BufferArg {
    into_contiguous(tensor.clone()).into_buffer_arg()
}
