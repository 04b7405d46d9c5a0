//! Every module equals a twin written in PyTorch from the specification: outputs, gradients, and not by chance.
//!
//! One file per twin; README.md says how the fixtures are made.

mod aggregate;
mod dino;
mod epipolar;
mod features;
mod fixture;
mod head;
mod matching;
mod network;
mod nyquist;
mod refine;
mod transformer;
mod unet;

use crate::NetConfig;
use burn::tensor::{Device, Int, Tensor, TensorData};

/// The settings `make_fixtures.py` reads too.
fn config() -> NetConfig {
    NetConfig::from_toml(include_str!("twin.toml")).unwrap()
}

/// The twins are differentiated, so everything here is.
fn device() -> Device {
    Device::flex().autodiff()
}

/// Each view's others.
fn others(views: usize) -> Vec<Vec<usize>> {
    (0..views).map(|v| (0..views).filter(|&o| o != v).collect()).collect()
}

/// Each view and its others.
fn with_itself(views: usize) -> Vec<Vec<usize>> {
    others(views).into_iter().enumerate().map(|(v, others)| [vec![v], others].concat()).collect()
}

fn indices(lists: &[Vec<usize>]) -> Tensor<2, Int> {
    let values: Vec<i32> = lists.iter().flatten().map(|&v| v as i32).collect();
    Tensor::from_data(TensorData::new(values, [lists.len(), lists[0].len()]), &device())
}
