//! What an import took, left and could not find.

use super::Reference;
use serde::Serialize;
use std::collections::BTreeMap;

/// A tensor of the source that was not used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Left {
    /// Its name in the file.
    pub name: String,
    /// Why, as the rest of a sentence that begins with the name.
    pub why: String,
}

/// The account of an import.
#[derive(Clone, Debug, Serialize)]
pub struct ImportReport {
    /// Whose weights they are.
    pub reference: Reference,
    /// Name in the source by our parameter.
    pub taken: BTreeMap<String, String>,
    /// Tensors of the source that were not used, by name.
    pub left: Vec<Left>,
    /// Our parameters that stayed fresh, in the order of the network.
    pub missing: Vec<String>,
    /// What was changed on the way.
    pub notes: Vec<String>,
}

impl ImportReport {
    /// How many tensors were left for each reason.
    pub fn reasons(&self) -> BTreeMap<&str, usize> {
        let mut reasons = BTreeMap::new();
        self.left.iter().for_each(|left| *reasons.entry(left.why.as_str()).or_default() += 1);
        reasons
    }

    /// How many parameters of each part of the network were taken, and how many it has.
    pub fn parts(&self) -> BTreeMap<&str, (usize, usize)> {
        let part = |name: &'_ str| name.split('.').next().unwrap_or_default().len();
        let mut parts: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
        for name in self.taken.keys() {
            let counts = parts.entry(&name[..part(name)]).or_default();
            *counts = (counts.0 + 1, counts.1 + 1);
        }
        for name in &self.missing {
            parts.entry(&name[..part(name)]).or_default().1 += 1;
        }
        parts
    }
}
