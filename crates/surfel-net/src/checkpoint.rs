//! Trained weights of the network as safetensors, named by the Rust modules (spec 2.12, our own format).
//!
//! Invariant: a file written by [`save`] loads into a network of the same configuration and no other; the
//! file is written beside its place and renamed, so a crash leaves the old one.

use crate::model::SurfelNet;
use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Tensor, TensorData};
use safetensors::Dtype;
use safetensors::tensor::TensorView;
use std::path::Path;
use surfel_features::WeightsError;
use surfel_features::weights::{TensorFile, read_file};

/// Writes all weights as f32.
///
/// # Errors
/// [`WeightsError::Unwritable`].
pub fn save(net: &SurfelNet, path: &Path) -> Result<(), WeightsError> {
    let mut collector = Collector::default();
    net.visit(&mut collector);
    let file = path.display().to_string();
    let unwritable = |reason: String| WeightsError::Unwritable { file: file.clone(), reason };
    let views = collector.tensors.iter().map(|(name, shape, bytes)| {
        let view = TensorView::new(Dtype::F32, shape.clone(), bytes).map_err(|error| unwritable(error.to_string()))?;
        Ok((name.as_str(), view))
    });
    let views = views.collect::<Result<Vec<_>, WeightsError>>()?;
    let bytes = safetensors::serialize(views, None).map_err(|error| unwritable(error.to_string()))?;
    let beside = path.with_extension("part");
    std::fs::write(&beside, bytes)
        .and_then(|()| std::fs::rename(&beside, path))
        .map_err(|error| unwritable(error.to_string()))
}

/// The network with all weights replaced by those of a file (f16 or f32).
///
/// # Errors
/// [`WeightsError`] when the file cannot be read, is damaged, or belongs to another configuration.
pub fn load(net: SurfelNet, path: &Path) -> Result<SurfelNet, WeightsError> {
    let bytes = read_file(path)?;
    filled(net, TensorFile::parse(path.display().to_string(), &bytes)?, &[])
}

/// A module with all weights replaced by those a file has under the parts of `prefix`.
pub(crate) fn filled<M: Module>(module: M, file: TensorFile, prefix: &[&str]) -> Result<M, WeightsError> {
    let path = ModulePath(prefix.iter().map(|&part| part.to_owned()).collect());
    let mut loader = Loader { file, path, error: None };
    let module = module.map(&mut loader);
    match loader.error {
        Some(error) => Err(error),
        None => Ok(module),
    }
}

/// Where in the module tree a traversal stands.
#[derive(Default)]
struct ModulePath(Vec<String>);

impl ModulePath {
    fn name(&self) -> String {
        self.0.join(".")
    }
}

#[derive(Default)]
struct Collector {
    path: ModulePath,
    tensors: Vec<(String, Vec<usize>, Vec<u8>)>,
}

impl ModuleVisitor for Collector {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.0.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.0.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let tensor = param.val();
        let shape = tensor.dims().to_vec();
        let bytes = crate::head::values(tensor).iter().flat_map(|value| value.to_le_bytes()).collect();
        self.tensors.push((self.path.name(), shape, bytes));
    }
}

struct Loader<'a> {
    file: TensorFile<'a>,
    path: ModulePath,
    error: Option<WeightsError>,
}

impl ModuleMapper for Loader<'_> {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.0.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.0.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let shape = param.val().dims();
        match self.file.values(&self.path.name(), &shape) {
            Ok(values) => param.map(|old| {
                let new = Tensor::from_data(TensorData::new(values, shape), &old.device());
                if old.is_require_grad() { new.require_grad() } else { new }
            }),
            Err(error) => {
                self.error.get_or_insert(error);
                param
            }
        }
    }
}
