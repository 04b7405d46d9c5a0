//! Weights of the reference implementations as a starting point for our network (spec 2.12).
//!
//! `source` reads names and tensors of a PyTorch or safetensors file, `reference` tells whose they are, `names`
//! says which of them is which of our parameters, `arrange` turns one into the other, `relative` changes the unit
//! of disparity. Invariant: a layer is taken whole or stays fresh, and the report accounts for every tensor of
//! the file and every parameter of the network.

mod arrange;
mod error;
mod names;
mod reference;
mod relative;
mod report;
mod source;

pub use error::ImportError;
pub use reference::Reference;
pub use report::{ImportReport, Left};
pub use source::Source;

use crate::checkpoint::tree::{Named, parameters, replace};
use crate::config::NetConfig;
use crate::model::SurfelNet;
use burn::tensor::Device;
use std::collections::{BTreeMap, BTreeSet};

/// The trunk's parts; half a trunk is of no use.
const TRUNK: [&str; 2] = ["cnn.", "transformer."];

/// A network of this configuration with everything that fits from `source`; the rest is fresh.
///
/// The head's hidden width and range of scales follow the source, as the configuration of the result says.
///
/// # Errors
/// [`ImportError`] when the source is of no known kind, damaged, or lacks a part of the trunk.
pub fn import(
    source: &mut Source,
    config: NetConfig,
    device: &Device,
) -> Result<(SurfelNet, ImportReport), ImportError> {
    let reference = Reference::of(source)?;
    let mut notes = Vec::new();
    let config = reference.adapted(config, source, &mut notes);
    let net = SurfelNet::new(config, device)?;
    let ours = parameters(&net);

    let mut plan = Vec::new();
    let mut unfit = BTreeMap::new();
    let mut broken_layers = BTreeSet::new();
    for parameter in &ours {
        let Some(origin) = names::origin(&parameter.name, net.config(), reference) else { continue };
        let theirs = reference.full_name(&origin.name);
        let Some(shape) = source.shape(&theirs) else { continue };
        match arrange::check(&origin.step, shape, &parameter.shape) {
            Ok(()) => plan.push((parameter, origin.step, shape.to_vec(), theirs)),
            Err(why) => {
                broken_layers.insert(layer(&parameter.name));
                unfit.insert(theirs, why);
            }
        }
    }
    let (mut taken, mut values) = (BTreeMap::new(), BTreeMap::new());
    for (parameter, step, shape, theirs) in plan {
        if broken_layers.contains(layer(&parameter.name)) {
            unfit.insert(theirs, "fits, but the rest of its layer does not".to_owned());
            continue;
        }
        values.insert(parameter.name.clone(), arrange::run(&step, &shape, source.values(&theirs)?));
        taken.insert(parameter.name.clone(), theirs);
    }
    require_trunk(source, &ours, &taken, &unfit, net.config(), reference)?;
    if let Some(range) = reference.absolute_disparity() {
        relative::convert(&mut values, &ours, net.config(), range);
        notes.push(format!(
            "disparities are relative to the depth range here; weights that read or write them were converted from the range {} to {} they were trained with",
            range.near, range.far
        ));
    }
    let report = ImportReport {
        reference,
        missing: ours.iter().map(|p| p.name.clone()).filter(|name| !taken.contains_key(name)).collect(),
        left: left(source, &taken, &unfit, reference),
        taken,
        notes,
    };
    Ok((replace(net, |name, _| values.remove(name)), report))
}

/// The layer of a parameter: its name without `weight`, `bias`, ...
fn layer(parameter: &str) -> &str {
    parameter.rsplit_once('.').map_or(parameter, |(layer, _)| layer)
}

fn require_trunk(
    source: &Source,
    ours: &[Named],
    taken: &BTreeMap<String, String>,
    unfit: &BTreeMap<String, String>,
    config: &NetConfig,
    reference: Reference,
) -> Result<(), ImportError> {
    // Attention along epipolar lines is in the trunk, but in none of the references.
    let in_trunk = |name: &str| {
        TRUNK.iter().any(|part| name.starts_with(part)) && names::origin(name, config, reference).is_some()
    };
    let trunk: Vec<&Named> = ours.iter().filter(|p| in_trunk(&p.name)).collect();
    let Some(first) = trunk.iter().find(|p| !taken.contains_key(&p.name)) else { return Ok(()) };
    let name = names::origin(&first.name, config, reference).map(|origin| reference.full_name(&origin.name));
    let name = name.unwrap_or_else(|| first.name.clone());
    let why = unfit.get(&name).cloned().unwrap_or_else(|| "is missing".to_owned());
    let found = trunk.iter().filter(|p| taken.contains_key(&p.name)).count();
    Err(ImportError::Trunk { file: source.file().to_owned(), name, why, found, needed: trunk.len() })
}

fn left(
    source: &Source,
    taken: &BTreeMap<String, String>,
    unfit: &BTreeMap<String, String>,
    reference: Reference,
) -> Vec<Left> {
    let used: BTreeSet<&str> = taken.values().map(String::as_str).collect();
    let unused = source.names().filter(|name| !used.contains(name));
    unused
        .map(|name| {
            let why = unfit.get(name).cloned().unwrap_or_else(|| reference.why_left(name).to_owned());
            Left { name: name.to_owned(), why }
        })
        .collect()
}
