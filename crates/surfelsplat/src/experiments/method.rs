//! The ways of getting a surface that experiments compare, by name.
//!
//! Invariant: a method of ours is one line of [`built_in`]; everything that lists, parses, runs or tabulates methods
//! reads that table. Networks with weights of their own and results of other programs join by name.

use crate::reconstruct::{DepthSource, Options};
use std::path::PathBuf;
use std::sync::Arc;
use surfel_net::{Device, SurfelNet};

/// One way of getting a surface out of photographs.
#[derive(Clone, Debug)]
pub struct Method {
    /// Short name, as typed and tabulated.
    pub name: String,
    /// What it is, in a few words.
    pub says: String,
    /// Where its depth comes from.
    pub depth: DepthFrom,
}

/// Where a method's depth comes from.
#[derive(Clone, Debug)]
pub enum DepthFrom {
    /// The truth itself: what the rest of the scoring costs.
    Truth,
    /// `reconstruct`, told so by changing its options.
    Road(fn(&mut Options)),
    /// `reconstruct` with this network.
    Network(Arc<SurfelNet>),
    /// Files that another program left: a folder per scene, named after it, with `depth/NN.pfm` for every view and, if
    /// there is one, `mesh.ply`.
    Files(PathBuf),
}

/// Every method that needs nothing but the program.
pub fn built_in() -> Vec<Method> {
    use DepthFrom::{Road, Truth};
    vec![
        Method::new("exact", "the exact depth: the floor of every figure", Truth),
        Method::new("matching", "plane sweep and refinement", Road(|_| {})),
        Method::new("matching-without-adaptation", "the same depth, surfels as fine as first placed", Road(unadapted)),
        Method::new("network", "matching, refined by the network that ships", Road(|o| o.depth = shipped(|net| net))),
        Method::new(
            "network-without-adaptation",
            "the same weights, regions of the surfels as first placed; not retrained",
            Road(|options| options.depth = shipped(SurfelNet::without_adaptation)),
        ),
        Method::new(
            "network-without-aggregation",
            "the same weights, surfels of the first head pass; not retrained",
            Road(|options| options.depth = shipped(SurfelNet::without_aggregation)),
        ),
        Method::new(
            "network-in-one-pass",
            "the same weights, depth of the first pass; not retrained",
            Road(|options| options.depth = shipped(|net| net.with_passes(1))),
        ),
    ]
}

/// A whole and the same without one part, by name: those of the paper's table 3, and our own passes.
pub const ABLATION: [&str; 4] =
    ["network", "network-without-adaptation", "network-without-aggregation", "network-in-one-pass"];

fn unadapted(options: &mut Options) {
    options.surfels.low_pass_px = 0.0;
}

/// The network that ships, changed.
fn shipped(change: fn(SurfelNet) -> SurfelNet) -> DepthSource {
    let net = SurfelNet::shipped(&Device::flex()).expect("a test reads the weights that ship");
    DepthSource::Network(Arc::new(change(net)))
}

impl Method {
    /// A method of these words.
    pub fn new(name: impl Into<String>, says: impl Into<String>, depth: DepthFrom) -> Self {
        Self { name: name.into(), says: says.into(), depth }
    }

    /// The built-in method of a name.
    pub fn named(name: &str) -> Option<Self> {
        built_in().into_iter().find(|method| method.name == name)
    }

    /// `options` as this method wants them; `None` for a method that does not reconstruct.
    pub fn options(&self, options: &Options) -> Option<Options> {
        let mut options = options.clone();
        match &self.depth {
            DepthFrom::Truth | DepthFrom::Files(_) => return None,
            DepthFrom::Road(set) => set(&mut options),
            DepthFrom::Network(net) => options.depth = DepthSource::Network(Arc::clone(net)),
        }
        Some(options)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_the_ablation_names_methods() {
        let methods = built_in();
        for (i, method) in methods.iter().enumerate() {
            assert_eq!(methods.iter().position(|other| other.name == method.name), Some(i), "{}", method.name);
        }
        assert!(ABLATION.iter().all(|name| Method::named(name).is_some()));
        let changed = Method::named("matching-without-adaptation").unwrap().options(&Options::default()).unwrap();
        assert_eq!(changed.surfels.low_pass_px, 0.0);
        let without = Method::named("network-without-aggregation").unwrap().options(&Options::default()).unwrap();
        let DepthSource::Network(net) = without.depth else { panic!("not a network") };
        assert!(!net.config().aggregation.enabled && net.config().nyquist.adaptation);
        assert!(Method::named("magic").is_none() && Method::named("exact").unwrap().options(&changed).is_none());
    }
}
