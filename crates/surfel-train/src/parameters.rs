//! The trained weights of a network as named lists of numbers, in and out.
//!
//! Names are those of the Rust modules, as in checkpoints. Invariant: [`assign`] of what [`read`] returned
//! changes nothing.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor, TensorData};
use std::collections::BTreeMap;
use surfel_net::{SurfelNet, values};

/// Values by name.
pub type Named = BTreeMap<String, Vec<f32>>;

/// All weights.
pub fn read(net: &SurfelNet) -> Named {
    let mut reader = Reader { path: Vec::new(), gradients: None, named: Named::new() };
    net.visit(&mut reader);
    reader.named
}

/// The gradients of all weights that have one.
pub fn gradients(net: &SurfelNet, gradients: &Gradients) -> Named {
    let mut reader = Reader { path: Vec::new(), gradients: Some(gradients), named: Named::new() };
    net.visit(&mut reader);
    reader.named
}

/// The network with the given weights; those not named stay.
pub fn assign(net: SurfelNet, named: &Named) -> SurfelNet {
    net.map(&mut Writer { path: Vec::new(), named })
}

/// The network of which only the weights learn whose names begin with one of `parts`.
///
/// # Errors
/// The first of `parts` with which no weight's name begins.
pub fn learning(net: SurfelNet, parts: &[String]) -> Result<SurfelNet, &str> {
    let names = read(&net);
    let is_unknown = |part: &&String| !names.keys().any(|name| name.starts_with(part.as_str()));
    match parts.iter().find(is_unknown) {
        Some(unknown) => Err(unknown),
        None => Ok(net.map(&mut Teacher { path: Vec::new(), parts })),
    }
}

struct Reader<'a> {
    path: Vec<String>,
    gradients: Option<&'a Gradients>,
    named: Named,
}

impl ModuleVisitor for Reader<'_> {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let read = match self.gradients {
            None => Some(values(param.val())),
            Some(gradients) => param.val().grad(gradients).map(values),
        };
        if let Some(read) = read {
            self.named.insert(self.path.join("."), read);
        }
    }
}

struct Writer<'a> {
    path: Vec<String>,
    named: &'a Named,
}

impl ModuleMapper for Writer<'_> {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let Some(new) = self.named.get(&self.path.join(".")) else { return param };
        param.map(|old| {
            let tensor = Tensor::from_data(TensorData::new(new.clone(), old.dims()), &old.device());
            if old.is_require_grad() { tensor.require_grad() } else { tensor }
        })
    }
}

struct Teacher<'a> {
    path: Vec<String>,
    parts: &'a [String],
}

impl ModuleMapper for Teacher<'_> {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let name = self.path.join(".");
        let learns = self.parts.iter().any(|part| name.starts_with(part.as_str()));
        param.map(|weights| weights.set_require_grad(learns))
    }
}
