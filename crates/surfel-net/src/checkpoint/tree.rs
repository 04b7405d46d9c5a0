//! The names of the network's parameters: the path of module fields, joined by dots.

use crate::model::SurfelNet;
use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Tensor, TensorData};

/// A parameter's name, shape and values, row-major.
pub(crate) struct Named {
    pub name: String,
    pub shape: Vec<usize>,
    pub values: Vec<f32>,
}

/// Every parameter, in the order of the modules.
pub(crate) fn parameters(net: &SurfelNet) -> Vec<Named> {
    let mut collector = Collector::default();
    net.visit(&mut collector);
    collector.parameters
}

/// Replaces parameters by what `new` gives for a name and a shape; `None` keeps the old values.
pub(crate) fn replace(net: SurfelNet, new: impl FnMut(&str, &[usize]) -> Option<Vec<f32>>) -> SurfelNet {
    replace_under(net, &[], new)
}

/// The same of any module, whose names are under the parts of `prefix`.
pub(crate) fn replace_under<M: Module>(
    module: M,
    prefix: &[&str],
    new: impl FnMut(&str, &[usize]) -> Option<Vec<f32>>,
) -> M {
    let path = ModulePath(prefix.iter().map(|&part| part.to_owned()).collect());
    module.map(&mut Replacer { path, new })
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
    parameters: Vec<Named>,
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
        self.parameters.push(Named { name: self.path.name(), shape, values: crate::layers::values(tensor) });
    }
}

struct Replacer<F> {
    path: ModulePath,
    new: F,
}

impl<F: FnMut(&str, &[usize]) -> Option<Vec<f32>>> ModuleMapper for Replacer<F> {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.0.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.0.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let shape = param.val().dims();
        match (self.new)(&self.path.name(), &shape) {
            None => param,
            Some(values) => param.map(|old| {
                let new = Tensor::from_data(TensorData::new(values, shape), &old.device());
                if old.is_require_grad() { new.require_grad() } else { new }
            }),
        }
    }
}
