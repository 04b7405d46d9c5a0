//! Which methods: the flags that the experiments share.
//!
//! Invariant: parsing opens no file; [`MethodArgs::methods`] does.

use anyhow::{Context, Result, bail};
use clap::Args;
use std::path::PathBuf;
use std::sync::Arc;
use surfel_net::{Device, SurfelNet};
use surfelsplat::experiments::Method;
use surfelsplat::experiments::method::{DepthFrom, built_in};

/// Methods by name.
#[derive(Debug, Args)]
pub struct MethodArgs {
    /// Methods that need no file of weights, by name: exact, matching, matching-without-adaptation, network,
    /// network-without-adaptation, network-without-aggregation, network-in-one-pass.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', value_parser = known)]
    method: Vec<String>,

    /// A network: a name for the tables and a file of weights (may be given several times).
    #[arg(long, value_name = "NAME=FILE", value_parser = named_path)]
    network: Vec<NamedPath>,
}

/// A name and a path.
#[derive(Clone, Debug)]
pub struct NamedPath {
    /// For tables.
    pub name: String,
    /// File or folder.
    pub path: PathBuf,
}

impl MethodArgs {
    /// The methods asked for, those of `default` if none was, with their weights loaded.
    pub fn methods(&self, default: &[&str]) -> Result<Vec<Method>> {
        let names: Vec<&str> = match self.method.is_empty() && self.network.is_empty() {
            true => default.to_vec(),
            false => self.method.iter().map(String::as_str).collect(),
        };
        let mut methods: Vec<Method> = names.into_iter().filter_map(Method::named).collect();
        for NamedPath { name, path } in &self.network {
            let net = SurfelNet::from_file(path, &Device::flex()).with_context(|| format!("--network {name}"))?;
            let says = format!("the network with the weights of {}", path.display());
            methods.push(Method::new(name, says, DepthFrom::Network(Arc::new(net))));
        }
        Ok(methods)
    }

    /// The one method asked for, `default` if none was.
    pub fn one(&self, default: &str) -> Result<Method> {
        let mut methods = self.methods(&[default])?;
        match (methods.pop(), methods.pop()) {
            (Some(only), None) => Ok(only),
            _ => bail!("this takes one method at a time"),
        }
    }
}

/// `NAME=PATH`.
pub fn named_path(text: &str) -> Result<NamedPath, String> {
    let (name, path) = text.split_once('=').ok_or("must be NAME=PATH, such as small=runs/small/best.safetensors")?;
    match name.trim() {
        "" => Err("has no name before the `=`".to_owned()),
        name => Ok(NamedPath { name: name.to_owned(), path: PathBuf::from(path) }),
    }
}

fn known(text: &str) -> Result<String, String> {
    let names: Vec<String> = built_in().into_iter().map(|method| method.name).collect();
    if names.iter().any(|name| name == text) {
        Ok(text.to_owned())
    } else {
        Err(format!("is none of {}", names.join(", ")))
    }
}
